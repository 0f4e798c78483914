"""What was found as a scene file: loaded by ``tactemu run``, with intervals and the recording's digest as comments."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from firmware_protocols import Device, Reading
from tactemu.fit.estimates import Findings
from tactemu.fit.recording import Recorded
from tactemu.scene.default import tables_for


def scene_text(name: str, device: type[Device], recorded: Sequence[Recorded], found: Findings) -> str:
    """Return a scene file of a device with what was found of recordings of one."""
    tables = tables_for(name, device)
    skin = tables["skin"][0]
    transducers = transducers_of(device, recorded[0], found)
    skin["options"] = options_of(device(), recorded[0], found, sees=sees(device, recorded[0]))
    if "rate" in found.estimates and not device.streams:
        skin["rate_hz"] = float(f"{found.value('rate'):.5g}")
    skin["clock"] = clock_of(found)
    scale = step_scale(recorded[0], found) if name == "anyskin" else None
    if scale is not None:
        skin["device_options"] = {"step_scale": scale}
    skin = {key: value for key, value in skin.items() if value != {}}
    lines = [*_head(recorded, found), *_table("scene", tables["scene"] or {"dt": 1e-3})]
    for body in tables["body"]:
        lines += _table("[body]", body)
    lines += _table("[skin]", skin)
    for each in transducers:
        lines += _table("[skin.transducer]", each)
    return "\n".join(lines).rstrip("\n") + "\n"


def _head(recorded: Sequence[Recorded], found: Findings) -> list[str]:
    lines = ["# Fitted by `tactemu fit`. In brackets: 95 % intervals."]
    lines += [f"# recording: {each.path.name}, SHA-256 {each.sha256}" for each in recorded]
    lines += [
        f"#   {estimate}{'; ' + estimate.about if estimate.about else ''}" for estimate in found.estimates.values()
    ]
    lines += [f"# not told: {each}" for each in found.unknown]
    return [*lines, ""]


def sees(device: type[Device], recorded: Recorded) -> str | None:
    """What the device sees through a transducer, where the recording is of that; ``None``: force."""
    from firmware_protocols.options import declared

    return recorded.kind if recorded.kind == "field" and "sees" in declared(device) else None


def clock_of(found: Findings) -> dict[str, Any]:
    """When it samples: two delays that are uniform up to a jitter differ by its square root of six, in std."""
    clock = {"missed": found.value("missed"), "refresh_s": found.value("refresh")}
    if found.told("period spread"):
        clock["jitter_s"] = min(np.sqrt(6) * found.value("period spread"), 1.0)
    return {name: float(f"{value:.3g}") for name, value in clock.items() if value}


def transducers_of(device: type[Device], recorded: Recorded, found: Findings) -> list[dict[str, Any]]:
    """Return tables of the transducers that were found, in their order."""
    made = device()
    area = float(np.mean(made.layout.areas)) if len(made.layout) else 1e-4
    tables: list[dict[str, Any]] = []
    names = {"loop": "loop", "softening": "softening", "baseline": "baseline", "creep per decade": "creep_per_decade"}
    material = {key: _short(found.value(name)) for name, key in names.items() if found.told(name)}
    if material:
        tables.append({"kind": "material", **material})
    load = recorded.load
    if "exponent" in found.estimates and load is not None:
        n, at_one = found.value("exponent"), found.value("resistance at 1 N")
        rated = float(load.max())
        half = (at_one / 1e4) ** (1.0 / n) / area  # where it equals a divider of 10 kOhm
        tables.append({"kind": "piezoresistive", "exponent": _short(n), "half": _short(half), "rated_n": _short(rated)})
    if "capacitance per N" in found.estimates:
        modulus = found.value("capacitance at rest") / max(found.value("capacitance per N"), 1e-30) / area
        band = max(found.value("dead band"), 0.0) / area
        tables.append(
            {"kind": "capacitive", "modulus": _short(modulus), "dead_band": _short(band),
             "rated_n": _short(modulus * area)}
        )  # fmt: skip
    if "tau" in found.estimates and "pressure" in made.contact:
        tables.append({"kind": "fluid", "tau": _short(found.value("tau"))})
    if sees(device, recorded) == "field":
        tables.append({"kind": "magnetic"} | magnets_of(made, found))
    return tables


def seeing(device: type[Device], recorded: Recorded) -> Device:
    """Return one that sees what was recorded, where it can."""
    seen = sees(device, recorded)
    options: dict[str, Any] = {} if seen is None else {"sees": seen}
    return device(**options)


def magnets_of(device: Device, found: Findings) -> dict[str, Any]:
    """Return a magnet over each chip, on the skin, which moves with the taxel there; nothing where none was found."""
    if "magnet height" not in found.estimates:
        return {}
    n = len(device.layout)
    across = device.layout.positions - device.layout.positions.mean(axis=0)
    return {
        "chip_depth": _short(found.value("magnet height")),
        "spread": 1e-3,
        "magnets": np.round(across, 7).tolist(),
        "moments": [[_short(found.value(f"moment {k} {axis}")) for axis in "xyz"] for k in range(n)],
    }


def options_of(device: Device, recorded: Recorded, found: Findings, *, sees: str | None) -> dict[str, Any]:
    """Imperfections: noise and its slow part, in the unit that the electronics sees."""
    axes = [axis for axis in (" x", " y", " z") if f"white noise{axis}" in found.estimates] or [""]
    white = [found.value(f"white noise{axis}") for axis in axes]
    if not any(white):
        return {}
    shares = [min(max(found.value(f"slow share{axis}"), 0.0), 0.98) for axis in axes]
    slow = [w * np.sqrt(share / (1.0 - share)) for w, share in zip(white, shares)]
    each = 1.0 if sees is not None else 1.0 / counts_per_newton(device, recorded)
    options: dict[str, Any] = {"noise": _per_column(device, white, each, whole=sees is not None)}
    tau = found.value(f"slow rows{axes[0]}") / found.value("rate", 100.0)
    if any(slow) and tau > 0:
        density = [s * np.sqrt(2.0 / tau) for s in slow]
        options |= {"random_walk_density": _per_column(device, density, each, whole=sees is not None)}
        options["random_walk_tau"] = _short(tau)
    return options


def _per_column(device: Device, values: Sequence[float], factor: float, *, whole: bool) -> Any:
    if whole and len(values) == 3:
        return [[_short(factor * value) for value in values] for _ in range(len(device.layout))]
    return _short(factor * float(np.mean(values)))


def counts_per_newton(device: Device, recorded: Recorded) -> float:
    """How much a device's readings of this kind move per newton on each taxel: its own converter is asked."""
    n = len(device.layout)
    if device.contact[0] != "force" or not n:
        return 1.0
    room = {"temperature": np.full(n, 25.0), "acceleration": np.zeros((n, 3)), "angular_velocity": np.zeros((n, 3))}

    def reads(push: float) -> np.ndarray:
        own = room | {"force": -push * np.asarray(device.layout.normals, float)}
        values = {sense.key: own.get(sense.quantity, np.zeros(len(sense.at or ()))) for sense in device.sensed}
        counts = device.measure(Reading(values), 0)
        first = next(iter(counts.values())) if isinstance(counts, dict) else counts
        return np.asarray(first, float).reshape(-1)

    moved = np.abs(reads(1.0) - reads(0.0))
    unit = 1e-6 if recorded.kind == "field" else 1.0
    return unit * float(np.median(moved[moved > 0])) if (moved > 0).any() else 1.0


DEFAULT_STEP_SCALE = 2
"""The option `step_scale` of a device that was given none."""


def step_scale(recorded: Recorded, found: Findings) -> int | None:
    """Which register setting of a MLX90393 the steps are of."""
    seen = found.value("resolution x")
    scales = [1, 2, 4, 8, 16]
    near = [scale for scale in scales if abs(seen / (0.150e-6 * scale) - 1) < 0.05]
    return near[0] if near and near[0] != DEFAULT_STEP_SCALE else None


def _short(value: float) -> float:
    return float(f"{value:.5g}")


def _table(name: str, values: dict[str, Any]) -> list[str]:
    plain = {key: value for key, value in values.items() if not isinstance(value, dict)}
    lines = [f"[{name}]", *(f"{key} = {_value(value)}" for key, value in plain.items()), ""]
    for key, value in values.items():
        if isinstance(value, dict) and value:
            lines[-1:] = [f"{key} = {_value(value)}", ""]
    return lines


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_value(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    return json.dumps(value.item() if isinstance(value, np.generic) else value)
