"""The places of the taxels on the fingertips of an ORCA Touch hand.

``orca_tips.csv`` has a line for each taxel, in the order on the wire: its part, whose full name is PXSR-CMD and that,
then position [0.01 mm], normal and x axis [0.001], in the frame of the fingertip. After the tables of orca-core 0.12.0
(MIT licence), hardware/sensing/models/touch-sensor-*/config.yaml.
"""

from pathlib import Path

import numpy as np

from firmware_protocols import Layout, Patch, place, stack

PARTS_BY_FINGER = {"thumb": "DP18A", "index": "DP18B", "middle": "DP18B", "ring": "DP18B", "pinky": "DP18C"}
TIP_SPACING_M = 0.025
TAXELS = np.loadtxt(Path(__file__).with_suffix(".csv"), str, delimiter=",", skiprows=1)
"""The lines of the table."""


def fingertips() -> Layout:
    """Return the taxels of all fingertips, side by side along x, each on the link of its finger."""
    tips = (tip(part, name=finger, link=finger) for finger, part in PARTS_BY_FINGER.items())
    return stack(*(place(each, (TIP_SPACING_M * k, 0.0, 0.0)) for k, each in enumerate(tips)))


def tip(part: str, *, name: str, link: str) -> Layout:
    """Return the taxels of one fingertip, in its frame."""
    rows = TAXELS[TAXELS[:, 0] == part, 1:].astype(float)
    normals = rows[:, 3:6] / np.linalg.norm(rows[:, 3:6], axis=1, keepdims=True)
    x_axes = rows[:, 6:] - (rows[:, 6:] * normals).sum(1, keepdims=True) * normals
    x_axes /= np.linalg.norm(x_axes, axis=1, keepdims=True)
    patch = Patch(name=name, start=0, rows=0, cols=len(rows), pitch=0.003, link=link)
    return Layout(positions=rows[:, :3] * 1e-5, normals=normals, x_axes=x_axes, patches=(patch,))
