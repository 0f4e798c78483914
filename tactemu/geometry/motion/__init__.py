"""Motions of bodies over time.

A motion is a *displacement from the pose at which its body was placed*, a function of time alone: translations along
the world's axes, rotations about the body's own origin. One motion therefore fits any body, and motions add up::

    ball = scene.add_body(Sphere(radius=0.01), position=(0, 0, 0.012), motion=Press(approach=0.002, depth=0.001))

Velocities are exact, not differences (a press at 1 m/s reads 1 m/s on every step); where the speed jumps, the value
is the one after the jump. Everything is float64. ``InTurn`` and ``Together`` combine motions; ``FromFunction`` makes
a motion of a function of time. The fields of the classes are also the keys of a scene file's ``[body.motion]`` tables.
"""

from __future__ import annotations

from tactemu.geometry.motion.combined import InTurn, Together
from tactemu.geometry.motion.driven import Joint
from tactemu.geometry.motion.free import FromFunction, Keyframes, Placed
from tactemu.geometry.motion.pose import Motion, Pose, Times
from tactemu.geometry.motion.strokes import Hold, Press, Roll, Slide, Spin
from tactemu.geometry.motion.track import PlainMotion

MOTIONS: dict[str, type[Motion]] = {
    m.kind: m for m in (Hold, Press, Slide, Roll, Spin, Keyframes, Joint, InTurn, Together)
}
"""The class of each ``kind`` in a scene file."""

__all__ = [
    "MOTIONS", "FromFunction", "Hold", "InTurn", "Joint", "Keyframes", "Motion", "Placed", "PlainMotion", "Pose",
    "Press", "Roll", "Slide", "Spin", "Times", "Together",
]  # fmt: skip
