"""The trade-off of speed and accuracy: `tactemu bench trade` measures the error and the cost of every setting.

The last reading of each setting and case is compared with that of a solution sixteen times as fine
(:mod:`tactemu.tune.trade.truth`), at four places less than a taxel apart: an error is the RMS over them, since the
error at one place may vanish by chance. Springs, points, depths and markers get one gain per quantity, fitted on a ball
pressed (and, for tangential forces, slid) 0.5 mm deep, and are evaluated on the other cases. Costs are medians of warm
steps of a sliding contact, measured in turn for all settings in one run.

Files in the folder: ``trade.json`` (all figures), ``trade.md`` (the table), ``trade.svg`` (the picture, with
matplotlib), ``results.jsonl`` and ``truth/`` (results that a later run uses again).
"""

from __future__ import annotations

import base64
import gc
import hashlib
import json
import os
import platform
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

import numpy as np
import warp as wp

from tactemu.base.errors import TactemuError
from tactemu.base.files import check_overwriting
from tactemu.base.jobs import Journal
from tactemu.sensors.models import model_class
from tactemu.sensors.sensor_model import Setting
from tactemu.tune.timing import Report, timed_step
from tactemu.tune.trade.cases import (
    CALIBRATION,
    CALIBRATION_OF_SHEAR,
    COST,
    OFFSET_STEPS,
    OFFSETS,
    PRESS_STEPS,
    Case,
    TestSkin,
    all_cases,
    build,
)
from tactemu.tune.trade.errors import Observation, errors, fit_gains, joined, observe, together
from tactemu.tune.trade.report import read_costs, summarise, write_page, write_table
from tactemu.tune.trade.scene import trade_of_scene
from tactemu.tune.trade.settings import calibrated_fields, ladder, make_model
from tactemu.tune.trade.truth import Truths, checks

FINE_STEPS = 10
"""The factor by which timed steps are smaller than those of the cases."""
ROUNDS = 3


@dataclass(frozen=True, kw_only=True)
class Cost:
    """The measured cost of a setting on this machine."""

    step_us: float
    """The median time of a warm step with a sliding contact."""
    still_us: float
    """The median time of a step in which nothing moves."""
    updates_per_s: float
    """The number of taxels read per second."""
    memory_bytes: int
    """The memory of the scene's arrays."""


@dataclass(frozen=True, kw_only=True)
class TradeOptions:
    """The settings and cases to measure, and the page of their table."""

    quick: bool = False
    """Use a coarser truth (256 cells) and twelve cases instead of forty-five."""
    only: str = ""
    """A part of the names of the settings to measure."""
    fresh: bool = False
    """Measure everything again."""
    times: bool = True
    """Measure the times; otherwise those of the page, or of the folder's last run, stay."""
    page: Path | None = None
    """A Markdown page whose table of settings is replaced."""


_SIGNS = {"trade.json": ('"warp":', '"rate_hz":'), "trade.md": ("Truth: ",), "trade.svg": ("matplotlib.org",)}
"""Texts of which the head of each file in the folder has one, by the file's name."""


def run_trade(
    report: Report = print,
    scene: str | None = None,
    *,
    out: str | Path = "trade",
    device: str = "cpu",
    options: TradeOptions = TradeOptions(),
    progress: Callable[[Iterable, str, int], Iterable] | None = None,
) -> dict:
    """Measure the trade-off and write it to a folder.

    Args:
        report: receives lines of text.
        scene: a scene file or a device: its own contacts and skins are measured instead of the eight objects.
        out: folder for the results; a later run continues from them.
        device: where the settings run: ``cpu`` or ``cuda:0``.
        options: what is measured.
        progress: ``progress(items, title, total)`` iterates over the items and shows progress.

    Returns:
        The content of ``trade.json``.

    Raises:
        TactemuError: times are not to be measured, and there are none of a setting; or a file in the folder is of
            another program.
    """
    folder = Path(out)
    for name, signs in _SIGNS.items():
        check_overwriting(folder / name, *signs)
    folder.mkdir(parents=True, exist_ok=True)
    progress = progress or (lambda items, _title, _total: items)
    if scene is not None:
        return trade_of_scene(report, scene, folder, device, progress)
    found = _measure(folder, device, options, report, progress)
    (folder / "trade.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    report(write_table(found, folder / "trade.md"))
    _draw(found, folder / "trade.svg", report)
    if options.page is not None:
        write_page(found, options.page)
        report(f"written into {options.page}")
    return found


def _measure(folder: Path, device: str, options: TradeOptions, report: Report, progress: Callable) -> dict:
    """Return the content of ``trade.json``: errors and costs of all settings."""
    skin, quick = TestSkin(), options.quick
    settings = [setting for setting in ladder() if options.only in setting.name]
    cases = all_cases(quick)
    truths = Truths(skin, 8 if quick else 16, folder / "truth")
    vouchers = checks(128 if quick else 256)
    report("\n".join([f"truth: {truths.name}", *(f"  {check.what}: {check.error:+.1e}" for check in vouchers)]))
    done = Results(folder / "results.jsonl", _digest(truths, device), options.fresh)
    needed = list(dict.fromkeys([*cases, CALIBRATION, CALIBRATION_OF_SHEAR]))
    for case in progress(needed, "truth", len(needed)):
        truths.of(case)
    _play_missing(done, skin, [(setting, case) for setting in settings for case in needed], device, progress)
    if options.times:
        costs = measure_costs(skin, settings, device, progress)
    else:
        costs = _earlier_costs(options.page or folder / "trade.md", skin, settings)
    judged = [
        _judge(skin, setting, cases, truths, done) | {"cost": asdict(costs[setting.name])} for setting in settings
    ]
    return {
        "machine": {"processor": platform.processor() or platform.machine(), "cores": os.cpu_count(), "device": device},
        "warp": wp.config.version,
        "truth": truths.name,
        "checks": [asdict(check) for check in vouchers],
        "calibration": [CALIBRATION.name, CALIBRATION_OF_SHEAR.name],
        "skin": asdict(skin),
        "settings": judged,
        "summary": summarise(judged),
    }


def _earlier_costs(page: Path, skin: TestSkin, settings: list[Setting]) -> dict[str, Cost]:
    """Return the costs that the table of a page has.

    Raises:
        TactemuError: it has none of a setting.
    """
    kept = read_costs(page.read_text(encoding="utf-8")) if page.exists() else {}
    missing = [setting.name for setting in settings if setting.name not in kept]
    if missing:
        raise TactemuError(f"{page} has no times of {', '.join(missing)}: measure them, without --no-times")
    return {
        setting.name: Cost(**kept[setting.name], updates_per_s=1e6 * skin.side**2 / kept[setting.name]["step_us"])
        for setting in settings
    }


def _play_missing(
    done: Results, skin: TestSkin, jobs: Sequence[tuple[Setting, Case]], device: str, progress: Callable
) -> None:
    """Observe each case with each setting that has no observation yet."""
    missing = [job for job in jobs if not done.has(*job)]
    for setting, case in progress(missing, "settings", len(missing)):
        done.add(setting, case, _play(skin, setting, case, device))


def _digest(truths: Truths, device: str) -> str:
    """Return a digest of skin, cases and device; results of different digests cannot be compared."""
    return hashlib.blake2b(f"3 {truths.skin} {device} {PRESS_STEPS} {OFFSETS}".encode(), digest_size=6).hexdigest()


class Results:
    """A journal of observations, which a later run reads."""

    def __init__(self, file: Path, digest: str, fresh: bool):
        if fresh:
            file.unlink(missing_ok=True)
        self._journal = Journal(file, "observation", digest)

    def _key(self, setting: Setting, case: Case) -> str:
        return f"{setting.name} {sorted(setting.options.items())} {case.name}"

    def has(self, setting: Setting, case: Case) -> bool:
        """Return True if the file has the observation of this setting and case."""
        return self._key(setting, case) in self._journal.results

    def get(self, setting: Setting, case: Case) -> list[Observation]:
        """Return the observations of a setting and case, one for each offset."""
        return [_unpack(packed) for packed in self._journal.results[self._key(setting, case)]]

    def add(self, setting: Setting, case: Case, seen: list[Observation]) -> None:
        """Keep the observations and append them to the file."""
        packed = [
            {name: None if value is None else _pack(value) for name, value in vars(each).items()} for each in seen
        ]
        self._journal.add(self._key(setting, case), packed)


def _pack(values: np.ndarray) -> dict:
    """Return an array as compressed text, which is short because most taxels of most readings are zero."""
    array = np.asarray(values)
    data = base64.b64encode(zlib.compress(array.tobytes(), 6)).decode()
    return {"dtype": str(array.dtype), "shape": array.shape, "data": data}


def _unpack(packed: dict) -> Observation:
    def array(entry: dict) -> np.ndarray:
        data = zlib.decompress(base64.b64decode(entry["data"]))
        return np.frombuffer(data, entry["dtype"]).reshape(entry["shape"])

    return Observation(**{name: None if entry is None else array(entry) for name, entry in packed.items()})


def _play(skin: TestSkin, setting: Setting, case: Case, device: str) -> list[Observation]:
    """Return the last reading of a case at each of its offsets."""
    sim, body, sensor = build(skin, case, make_model(setting, skin), setting.dtype, device)
    found = []
    for x, y in OFFSETS:
        sim.reset()
        for pose in case.poses(shift=(x * skin.pitch / OFFSET_STEPS, y * skin.pitch / OFFSET_STEPS)):
            sim.set_pose(body, **pose)
            sim.step()
        found.append(observe(sensor.read(), skin.pitch**2, threshold=2e-6))
    return found


def _gains(setting: Setting, truths: Truths, done: Results) -> dict[str, float]:
    """Return the gains of a setting: normal quantities and markers fitted to a press, tangential forces to a slide."""
    fields = calibrated_fields(setting)
    still = tuple(name for name in fields if name not in ("drag", "shift"))
    moving = tuple(name for name in fields if name == "drag")
    both = tuple(name for name in fields if name == "shift")

    def fitted(case: Case, names: tuple[str, ...]) -> dict[str, float]:
        return fit_gains(joined(done.get(setting, case)), joined(truths.of(case)), names)

    return fitted(CALIBRATION, still + both) | fitted(CALIBRATION_OF_SHEAR, moving)


def _judge(skin: TestSkin, setting: Setting, cases: list[Case], truths: Truths, done: Results) -> dict:
    gains = _gains(setting, truths, done)
    positions = skin.positions()[..., :2].reshape(-1, 2)
    found = {}
    for case in cases:
        found[case.name] = together([
            errors(seen.scaled(gains), truth, positions, skin.pitch**2, skin.friction)
            for seen, truth in zip(done.get(setting, case), truths.of(case))
        ])  # fmt: skip
    fitted = {CALIBRATION.name, CALIBRATION_OF_SHEAR.name} if calibrated_fields(setting) else set()
    return {
        "name": setting.name,
        "level": model_class(setting.model).level,
        "model": setting.model,
        "options": dict(setting.options),
        "dtype": setting.dtype,
        "gains": gains,
        "calibrated_on": sorted(fitted),
        "errors": found,
    }


def measure_costs(skin: TestSkin, settings: list[Setting], device: str, progress) -> dict[str, Cost]:
    """Time warm steps of all settings in turn, in several rounds, so that a disturbance affects all of them."""
    runs, memory = {}, {}
    for setting in settings:
        gc.collect()
        before = _held_bytes()
        runs[setting.name] = build(skin, COST, make_model(setting, skin), setting.dtype, device)
        memory[setting.name] = _held_bytes() - before
    moving = {setting.name: [] for setting in settings}
    still = {setting.name: [] for setting in settings}
    poses = list(COST.poses(fine=FINE_STEPS))
    for _ in progress(range(ROUNDS), "cost", ROUNDS):
        for name, (sim, body, _sensor) in runs.items():
            for k, pose in enumerate(poses):
                sim.set_pose(body, **pose)
                took = timed_step(sim)
                if k >= PRESS_STEPS + 3:
                    moving[name].append(took)
            for _k in range(20):
                still[name].append(timed_step(sim))
    taxels = skin.side**2
    return {
        name: Cost(
            step_us=median(times) * 1e6,
            still_us=median(still[name]) * 1e6,
            updates_per_s=taxels / median(times),
            memory_bytes=memory[name],
        )
        for name, times in moving.items()
    }


def _held_bytes() -> int:
    """Return the size of all Warp arrays that own their memory [bytes]."""
    arrays = (item for item in gc.get_objects() if isinstance(item, wp.array))
    return sum(array.capacity or 0 for array in arrays if getattr(array, "deleter", None) is not None)


def _draw(found: dict, file: Path, report: Report) -> None:
    try:
        from tactemu.tune.trade.picture import draw
    except ImportError:
        report("no picture: it needs matplotlib (pip install 'tactemu[plots]')")
        return
    draw(found, file)
    report(f"picture: {file}")
