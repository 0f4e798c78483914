"""The findings of a fit as a scene file for ``tactemu run``, with intervals and the recording's digest as comments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from firmware_protocols import Device
from firmware_protocols.check.readings import reading_of
from tactemu.base.toml_text import lines_of
from tactemu.base.units import DEFAULT_STEP_S
from tactemu.fit.estimates import Findings
from tactemu.fit.recording import Recorded
from tactemu.scene.default import tables_for

SIGN = "# Fitted by `tactemu fit`"
"""The begin of each scene file that is written here."""


def scene_text(name: str, device: type[Device], recorded: Sequence[Recorded], found: Findings) -> str:
    """Return a scene file of a device with the findings from its recordings."""
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
    lines = [*_head(recorded, found), *_table("scene", tables["scene"] or {"dt": DEFAULT_STEP_S})]
    for body in tables["body"]:
        lines += _table("[body]", body)
    lines += _table("[skin]", skin)
    for each in transducers:
        lines += _table("[skin.transducer]", each)
    return "\n".join(lines).rstrip("\n") + "\n"


def _head(recorded: Sequence[Recorded], found: Findings) -> list[str]:
    lines = [f"{SIGN}. In brackets: 95 % intervals."]
    lines += [f"# recording: {each.path.name}, SHA-256 {each.sha256}" for each in recorded]
    lines += [
        f"#   {estimate}{'; ' + estimate.about if estimate.about else ''}" for estimate in found.estimates.values()
    ]
    lines += [f"# not determined: {each}" for each in found.unknown]
    return [*lines, ""]


def sees(device: type[Device], recorded: Recorded) -> str | None:
    """Return the quantity of the transducer if the device has one and the recording is of it; None: force."""
    from firmware_protocols.options import declared

    return recorded.kind if recorded.kind == "field" and "sees" in declared(device) else None


def clock_of(found: Findings) -> dict[str, Any]:
    """Return the clock table of the skin.

    The standard deviation of the difference of two delays, each uniform up to a jitter, is jitter/√6.
    """
    clock = {"missed": found.value("missed"), "refresh_s": found.value("refresh")}
    if found.is_nonzero("period spread"):
        clock["jitter_s"] = min(np.sqrt(6) * found.value("period spread"), 1.0)
    return {name: float(f"{value:.3g}") for name, value in clock.items() if value}


def transducers_of(device: type[Device], recorded: Recorded, found: Findings) -> list[dict[str, Any]]:
    """Return the tables of the transducers that were found, in their order."""
    made = device()
    area = float(np.mean(made.layout.areas)) if len(made.layout) else 1e-4
    tables: list[dict[str, Any]] = []
    names = {"loop": "loop", "softening": "softening", "baseline": "baseline", "creep per decade": "creep_per_decade"}
    material = {key: _short(found.value(name)) for name, key in names.items() if found.is_nonzero(name)}
    if material:
        tables.append({"kind": "material", **material})
    load = recorded.load
    if "exponent" in found.estimates and load is not None:
        n, at_one = found.value("exponent"), found.value("resistance at 1 N")
        rated = float(load.max())
        half = (at_one / 1e4) ** (1.0 / n) / area  # the pressure at which it equals a fixed resistor of 10 kOhm
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


def device_for(device: type[Device], recorded: Recorded) -> Device:
    """Return a device whose transducer has the recorded quantity, if it has that option."""
    seen = sees(device, recorded)
    options: dict[str, Any] = {} if seen is None else {"sees": seen}
    return device(**options)


def magnets_of(device: Device, found: Findings) -> dict[str, Any]:
    """Return the options of one magnet over each chip, which moves with the taxel there; none if none was found."""
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
    """Return the imperfections: noise and its slow part, in the unit of the electronics' input."""
    axes = [axis for axis in (" x", " y", " z") if f"white noise{axis}" in found.estimates] or [""]
    white = [found.value(f"white noise{axis}") for axis in axes]
    if not any(white):
        return {}
    shares = [min(max(found.value(f"slow share{axis}"), 0.0), 0.98) for axis in axes]
    slow = [w * np.sqrt(share / (1.0 - share)) for w, share in zip(white, shares)]
    each = 1.0 if sees is not None else 1.0 / counts_per_newton(device, recorded)
    options: dict[str, Any] = {"noise": _per_column(device, white, each, by_axis=sees is not None)}
    tau = found.value(f"slow rows{axes[0]}") / found.value("rate", 100.0)
    if any(slow) and tau > 0:
        density = [s * np.sqrt(2.0 / tau) for s in slow]
        options |= {"random_walk_density": _per_column(device, density, each, by_axis=sees is not None)}
        options["random_walk_tau"] = _short(tau)
    return options


def _per_column(device: Device, values: Sequence[float], factor: float, *, by_axis: bool) -> Any:
    if by_axis and len(values) == 3:
        return [[_short(factor * value) for value in values] for _ in range(len(device.layout))]
    return _short(factor * float(np.mean(values)))


def counts_per_newton(device: Device, recorded: Recorded) -> float:
    """Return the change of a device's readings per newton on each taxel, by its own conversion."""
    if device.contact[0] != "force" or not len(device.layout):
        return 1.0

    def reads(push: float) -> np.ndarray:
        counts = device.measure(reading_of(device, push), 0)
        first = next(iter(counts.values())) if isinstance(counts, dict) else counts
        return np.asarray(first, float).reshape(-1)

    moved = np.abs(reads(1.0) - reads(0.0))
    unit = 1e-6 if recorded.kind == "field" else 1.0
    return unit * float(np.median(moved[moved > 0])) if (moved > 0).any() else 1.0


DEFAULT_STEP_SCALE = 2
"""The default of a device's option `step_scale`."""


def step_scale(recorded: Recorded, found: Findings) -> int | None:
    """Return the register setting of a MLX90393 that the steps of the readings match, or None for the default."""
    seen = found.value("resolution x")
    scales = [1, 2, 4, 8, 16]
    near = [scale for scale in scales if abs(seen / (0.150e-6 * scale) - 1) < 0.05]
    return near[0] if near and near[0] != DEFAULT_STEP_SCALE else None


def _short(value: float) -> float:
    return float(f"{value:.5g}")


def _table(name: str, values: dict[str, Any]) -> list[str]:
    plain = {key: value for key, value in values.items() if not isinstance(value, dict)}
    tables = {key: value for key, value in values.items() if isinstance(value, dict) and value}
    return [f"[{name}]", *lines_of(plain | tables), ""]
