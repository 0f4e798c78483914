"""Estimates from presses at known places: the position of each taxel, their order, and how the skin was turned.

A taxel at ``c`` with its own width ``w`` reads ``a F exp(−|p − c|²/2w²)`` of a load ``F`` at ``p``. The places found
are matched with the device's own in every order, turned and moved: among equal fits the device's own order comes first,
then the smallest turn.
"""

from __future__ import annotations

import numpy as np

from firmware_protocols import Device
from tactemu.fit.estimates import Z_95, Findings, nonlinear
from tactemu.fit.recording import Recorded

MIN_PLACES = 3
"""Minimum number of taxels whose places must be found."""
MAX_ROWS = 1200
"""Maximum number of rows in the fit of a taxel's place."""
TURNS = np.radians(np.arange(0.0, 360.0, 5.0))
"""The turns from which matching begins [rad]."""
MAX_TAXELS = 300
"""Maximum number of taxels; of more, places are not estimated."""


def find_places(recorded: Recorded, device: Device, found: Findings) -> None:
    """Add order and turn of the taxels, by the places of the recording and of the device."""
    if "x" not in recorded.truth or "y" not in recorded.truth:
        found.unknown.append(
            "order and turn of the taxels: record the probe's position (`x`, `y`) in presses all over the skin"
        )
        return
    load = recorded.load if recorded.load is not None else recorded.truth.get("depth")
    layout = device.layout
    n, axes = len(layout), 3 if recorded.kind == "field" else 1
    if load is None or not 2 < n <= MAX_TAXELS or recorded.readings.shape[1] != axes * n or np.ptp(load) == 0:
        found.unknown.append(f"order and turn of the taxels: they need a load, and {axes * n} columns of {n} taxels")
        return
    across = layout.positions - layout.positions.mean(axis=0)
    u, _, w = np.linalg.svd(across)[2]
    if np.ptp(across @ w) > 1e-6:
        found.unknown.append("order and turn of the taxels: the layout is not flat")
        return
    x_axis = np.array([1.0, 0.0, 0.0]) if abs(w[2]) > 0.9 else u
    own = np.column_stack([across @ x_axis, across @ np.cross(w if w[2] >= 0 else -w, x_axis)])
    centres, errors = _centres(recorded, load, n, axes)
    seen = np.isfinite(centres).all(axis=1) & (errors < 0.5 * _pitch(own))
    if seen.sum() < max(MIN_PLACES, 0.8 * n):
        found.unknown.append(
            f"order and turn of taxels: {int(seen.sum())} of {n} were pressed well; press beside each from all sides"
        )
        return
    _lay(centres, errors, seen, own, found)


def _pitch(own: np.ndarray) -> float:
    apart = np.linalg.norm(own[:, None] - own[None], axis=-1) + np.where(np.eye(len(own)), np.inf, 0.0)
    return float(np.median(apart.min(axis=1)))


def _centres(recorded: Recorded, load: np.ndarray, n: int, axes: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the place where each taxel reads most [m], ``(n, 2)``, and its standard error; NaN if undetermined."""
    free = load <= load.min() + 0.02 * np.ptp(load)
    rest = np.median(recorded.readings[free], axis=0) if free.any() else recorded.readings.min(axis=0)
    signal = np.linalg.norm((recorded.readings - rest).reshape(len(load), n, axes), axis=-1)
    pressed = np.flatnonzero(load > 0.3 * load.max())
    rows = pressed[np.unique(np.linspace(0, len(pressed) - 1, MAX_ROWS).astype(int))]
    places = np.column_stack([recorded.truth["x"], recorded.truth["y"]])[rows]
    drive, width = load[rows] / load.max(), 0.25 * float(np.ptp(places, axis=0).max())
    centres, errors = np.full((n, 2), np.nan), np.full(n, np.inf)
    for k in range(n):
        y = signal[rows, k] / drive
        scale = float(np.percentile(y, 99))
        if scale <= 4.0 * float(np.median(np.abs(signal[free, k]))) or not scale:
            continue
        high = y > 0.5 * scale
        begin = [*np.median(places[high], axis=0), 1.0, np.log(width)]

        def apart(p: np.ndarray, y: np.ndarray = y, scale: float = scale) -> np.ndarray:
            square = ((places - p[:2]) ** 2).sum(axis=1) / np.exp(2 * p[3])
            return np.clip(drive * (p[2] * np.exp(-0.5 * square) - y / scale), -0.5, 0.5)

        low, most = places.min(axis=0) - width, places.max(axis=0) + width
        ends = ([*low, 0.1, np.log(0.02 * width)], [*most, 10.0, np.log(20 * width)])
        law, sure = nonlinear(apart, np.clip(begin, ends[0], ends[1]), ends)
        centres[k], errors[k] = law[:2], float(np.hypot(sure[0], sure[1]))
    return centres, errors


def _lay(centres: np.ndarray, errors: np.ndarray, seen: np.ndarray, own: np.ndarray, found: Findings) -> None:
    """Match the places found with the device's, and add order and turn."""
    from scipy.optimize import linear_sum_assignment

    here, sure = centres[seen], errors[seen]
    index, pitch = np.flatnonzero(seen), _pitch(own)
    fits: list[tuple[float, float, bool, np.ndarray]] = []
    for mirrored in (False, True):
        face = own * [1.0, -1.0] if mirrored else own
        for turn in TURNS:
            angle, shift, to = float(turn), here.mean(axis=0), index
            for _ in range(3):
                laid = face @ _turned(angle).T + shift
                to = linear_sum_assignment(((here[:, None] - laid[None]) ** 2).sum(axis=-1))[1]
                angle, shift = _rigid(face[to], here)
            laid = face @ _turned(angle).T + shift
            rms = float(np.sqrt(np.mean(((here - laid[to]) ** 2).sum(axis=1))))
            fits.append((rms, float(angle), mirrored, to))
    least = min(fit[0] for fit in fits)
    if least > 0.4 * pitch:
        found.unknown.append(
            f"order and turn of the taxels: places found are {1e3 * least:.1f} mm from any order of them"
        )
        return
    near = [fit for fit in fits if fit[0] < least + 0.1 * pitch]
    rms, angle, mirrored, to = max(near, key=lambda fit: (not fit[2], int((fit[3] == index).sum()), -abs(fit[1])))
    spread = np.linalg.norm(here - here.mean(axis=0), axis=1)
    error = float(np.sqrt((sure**2 * spread**2).sum() / 2) / (spread**2).sum())
    error = max(error, rms / np.sqrt(2) / np.linalg.norm(spread))
    found.add("turn", np.degrees(angle), np.degrees(error), "deg", "of the device's frame against the probe's x and y")
    found.add("places", rms, 0.0, "m", "rms distance of the taxels found from the device's")
    swapped = [f"{i} is the device's {j}" for i, j in zip(index.tolist(), to.tolist()) if i != j]
    order = f"not as the device's: {', '.join(swapped[:12])}" + (" ..." if len(swapped) > 12 else "")
    found.notes.append(f"order of the taxels: {order if swapped else 'as of the device'}")
    if mirrored:
        found.notes.append("the taxels lie mirrored: is an axis of the probe's places turned round?")
    if abs(np.degrees(angle)) > Z_95 * np.degrees(error) + 2.0:
        found.notes.append(f"the skin was turned by {np.degrees(angle):.0f} degrees")


def _turned(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _rigid(face: np.ndarray, here: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the turn and the shift that move ``face`` onto ``here``."""
    a, b = face - face.mean(axis=0), here - here.mean(axis=0)
    angle = float(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
    return angle, here.mean(axis=0) - face.mean(axis=0) @ _turned(angle).T
