"""The trade-off of speed and accuracy: `tactemu bench trade` measures the error and the cost of every setting.

The last reading of each setting and case is compared with that of a solution sixteen times as fine
(:mod:`tactemu.tune.trade.truth`). Springs, points, depths and markers get one gain per quantity, fitted on a ball
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

from tactemu.base.jobs import Journal
from tactemu.sensors.models import model_class
from tactemu.sensors.sensor_model import Setting
from tactemu.tune.timing import Report, timed_step
from tactemu.tune.trade.cases import (
    CALIBRATION,
    CALIBRATION_OF_SHEAR,
    COST,
    PRESS_STEPS,
    Case,
    TestSkin,
    all_cases,
    build,
)
from tactemu.tune.trade.errors import Observation, errors, fit_gains, observe
from tactemu.tune.trade.report import summarise, write_table
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


def run_trade(
    report: Report = print,
    scene: str | None = None,
    *,
    out: str | Path = "trade",
    quick: bool = False,
    device: str = "cpu",
    only: str = "",
    fresh: bool = False,
    progress: Callable[[Iterable, str, int], Iterable] | None = None,
) -> dict:
    """Measure the trade-off and write it to a folder.

    Args:
        report: receives lines of text.
        scene: a scene file or a device: its own contacts and skins are measured instead of the seven objects.
        out: folder for the results; a later run continues from them.
        quick: use a coarser truth (256 cells) and ten cases instead of thirty-five.
        device: where the settings run: ``cpu`` or ``cuda:0``.
        only: part of the names of the settings to measure.
        fresh: measure everything again.
        progress: ``progress(items, title, total)`` iterates over the items and shows progress.

    Returns:
        The content of ``trade.json``.
    """
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    progress = progress or (lambda items, _title, _total: items)
    if scene is not None:
        return trade_of_scene(report, scene, folder, device, progress)
    skin = TestSkin()
    settings = [setting for setting in ladder() if only in setting.name]
    cases = all_cases(quick)
    truths = Truths(skin, 8 if quick else 16, folder / "truth")
    vouchers = checks(128 if quick else 256)
    report("\n".join([f"truth: {truths.name}", *(f"  {check.what}: {check.error:+.1e}" for check in vouchers)]))
    done = Results(folder / "results.jsonl", _digest(truths, device), fresh)
    needed = list(dict.fromkeys([*cases, CALIBRATION, CALIBRATION_OF_SHEAR]))
    for case in progress(needed, "truth", len(needed)):
        truths.of(case)
    _play_missing(done, skin, [(setting, case) for setting in settings for case in needed], device, progress)
    costs = measure_costs(skin, settings, device, progress)
    found = {
        "machine": {"processor": platform.processor() or platform.machine(), "cores": os.cpu_count(), "device": device},
        "warp": wp.config.version,
        "truth": truths.name,
        "checks": [asdict(check) for check in vouchers],
        "calibration": [CALIBRATION.name, CALIBRATION_OF_SHEAR.name],
        "skin": asdict(skin),
        "settings": [
            _judge(skin, setting, cases, truths, done) | {"cost": asdict(costs[setting.name])} for setting in settings
        ],
    }
    found["summary"] = summarise(found["settings"])
    (folder / "trade.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    report(write_table(found, folder / "trade.md"))
    _draw(found, folder / "trade.svg", report)
    return found


def _play_missing(
    done: Results, skin: TestSkin, jobs: Sequence[tuple[Setting, Case]], device: str, progress: Callable
) -> None:
    """Observe each case with each setting that has no observation yet."""
    missing = [job for job in jobs if not done.has(*job)]
    for setting, case in progress(missing, "settings", len(missing)):
        done.add(setting, case, _play(skin, setting, case, device))


def _digest(truths: Truths, device: str) -> str:
    """Return a digest of skin, cases and device; results of different digests cannot be compared."""
    return hashlib.blake2b(f"2 {truths.skin} {device} {PRESS_STEPS}".encode(), digest_size=6).hexdigest()


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

    def get(self, setting: Setting, case: Case) -> Observation:
        """Return the observation of a setting and case."""
        return _unpack(self._journal.results[self._key(setting, case)])

    def add(self, setting: Setting, case: Case, seen: Observation) -> None:
        """Keep the observation and append it to the file."""
        packed = {name: None if value is None else _pack(value) for name, value in vars(seen).items()}
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


def _play(skin: TestSkin, setting: Setting, case: Case, device: str) -> Observation:
    sim, body, sensor = build(skin, case, make_model(setting, skin), setting.dtype, device)
    for pose in case.poses():
        sim.set_pose(body, **pose)
        sim.step()
    return observe(sensor.read(), skin.pitch**2, threshold=2e-6)


def _gains(setting: Setting, truths: Truths, done: Results) -> dict[str, float]:
    """Return the gains of a setting: normal quantities and markers fitted to a press, tangential forces to a slide."""
    fields = calibrated_fields(setting)
    still = tuple(name for name in fields if name not in ("drag", "shift"))
    moving = tuple(name for name in fields if name == "drag")
    both = tuple(name for name in fields if name == "shift")
    gains = fit_gains(done.get(setting, CALIBRATION), truths.of(CALIBRATION), still + both)
    return gains | fit_gains(done.get(setting, CALIBRATION_OF_SHEAR), truths.of(CALIBRATION_OF_SHEAR), moving)


def _judge(skin: TestSkin, setting: Setting, cases: list[Case], truths: Truths, done: Results) -> dict:
    gains = _gains(setting, truths, done)
    positions = skin.positions()[..., :2].reshape(-1, 2)
    found = {}
    for case in cases:
        seen = done.get(setting, case).scaled(gains)
        found[case.name] = errors(seen, truths.of(case), positions, skin.pitch**2, skin.friction)
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
