"""A scene for a device without one: its taxels on a pad, and a ball that presses the middle of each patch."""

from __future__ import annotations

from typing import Any

import numpy as np

from firmware_protocols import Device, Layout

IDLE_S = 2.0
"""Time after booting in which nothing touches the skin, so that drivers that calibrate when they open measure rest."""
PERIOD_S = 2.0
"""Duration of one press of the default scene."""


def tables_for(name: str, device: type[Device], **device_options) -> dict[str, Any]:
    """Return the tables of a default scene for ``device``, made from its layout.

    ``name`` is the device's name in a scene file.
    """
    data = {"scene": {}, "body": [_pad()], "skin": [{"device": name, "link": "pad", "device_options": device_options}]}
    made = device(**device_options)
    layout, presses = made.layout, len(made.layout.patches)
    for number, patch in enumerate(layout.patches):
        ball = _ball(f"ball {patch.name}" if presses > 1 else "ball", layout, patch.taxels, patch.pitch)
        ball["motion"]["delay"] = made.boot_s + IDLE_S + 0.25 * number
        if any(sense.quantity == "wrench" for sense in made.sensed):
            ball["motion"]["direction"] = _oblique(ball["motion"]["direction"])
        data["body"].append(ball)
    return data


def _oblique(direction: list[float]) -> list[float]:
    """Return a direction beside another one, so that a wrench has all of its six components."""
    beside = np.cross(direction, np.roll(direction, 1))
    return (np.array(direction) + 0.3 * beside + 0.2 * np.cross(direction, beside)).tolist()


def _pad() -> dict[str, Any]:
    """Return a link without a shape, so that taxels touch other bodies only."""
    return {"name": "pad", "shape": "frame", "fixed": True}


def _ball(name: str, layout: Layout, taxels: slice, pitch: float) -> dict[str, Any]:
    """Return a ball over the taxel nearest to the patch's middle, on its normal, with a radius of three pitches."""
    positions, normals = layout.positions[taxels], layout.normals[taxels]
    middle = np.argmin(np.linalg.norm(positions - positions.mean(axis=0), axis=1))
    normal = normals[middle]
    radius, gap = 3 * pitch, pitch
    return {
        "name": name,
        "shape": "sphere",
        "radius": radius,
        "position": (positions[middle] + (radius + gap) * normal).tolist(),
        "motion": {
            "kind": "press",
            "direction": (-normal).tolist(),
            "approach": gap,
            "depth": 0.5 * pitch,
            "speed": 2 * gap / PERIOD_S,
            "release_speed": 8 * gap / PERIOD_S,
            "dwell": 0.25 * PERIOD_S,
            "pause": 0.25 * PERIOD_S,
            "repeat": 0,
        },
    }
