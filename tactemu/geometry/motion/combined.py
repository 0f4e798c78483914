"""Motions that combine others, one after another or at the same time."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactemu.base.errors import SceneError
from tactemu.geometry.motion.pose import Motion, Pose, Times


def _check_motions(combined: Motion, parts: tuple[Motion, ...]) -> None:
    if not isinstance(parts, tuple | list) or not parts or not all(isinstance(part, Motion) for part in parts):
        raise SceneError(f"{combined.kind}: expected one or more motions, got {parts!r}")


@dataclass(frozen=True)
class InTurn(Motion):
    """Motions one after another, each starting where the one before it ended; ``repeat`` starts them over again."""

    kind = "sequence"
    motions: tuple[Motion, ...]
    repeat: bool = False

    def __post_init__(self):
        _check_motions(self, self.motions)
        endless = [m.kind for m in self.motions[:-1] if math.isinf(m.duration)]
        if endless:
            raise SceneError(f"sequence: only the last motion may be endless; {endless[0]!r} never ends")
        if self.repeat and not 0 < self.duration_once < math.inf:
            raise SceneError(f"sequence: to repeat, it must last a finite time > 0 s, got {self.duration_once} s")

    @cached_property
    def starts(self) -> list[tuple[float, Pose]]:
        """The start time [s] of each motion, and the displacement that the motions before it left."""
        t, pose, found = 0.0, Pose(), []
        for motion in self.motions:
            found.append((t, pose))
            if math.isfinite(motion.duration):
                t += motion.duration
                end = motion.pose(motion.duration)
                pose = pose.displaced(Pose(end.position, end.quaternion))
        return found

    @property
    def duration_once(self) -> float:
        """The duration of one pass [s]."""
        return math.fsum(m.duration for m in self.motions)

    @property
    def duration(self) -> float:
        return math.inf if self.repeat else self.duration_once

    def pose(self, t_s: Times) -> Pose:
        if isinstance(t_s, np.ndarray):
            return self._poses(t_s)
        if self.repeat and t_s > 0:
            t_s %= self.duration_once
        at = max(bisect.bisect_right(self.starts, t_s, key=lambda entry: entry[0]) - 1, 0)
        start, left = self.starts[at]
        return left.displaced(self.motions[at].pose(t_s - start))

    def _poses(self, times: np.ndarray) -> Pose:
        """Return the pose at each of an array of times."""
        if self.repeat:
            times = np.where(times > 0, times % self.duration_once, times)
        at = np.searchsorted([start for start, _ in self.starts], times, side="right") - 1
        found = Pose(*(np.zeros((len(times), width)) for width in (3, 4, 3, 3)))
        for k in np.unique(at.clip(0)):
            here, (start, left) = at.clip(0) == k, self.starts[k]
            for part, values in zip(found, left.displaced(self.motions[k].pose(times[here] - start))):
                part[here] = values
        return found


@dataclass(frozen=True)
class Together(Motion):
    """Motions at the same time: translations add up, rotations are applied in the order given."""

    kind = "together"
    motions: tuple[Motion, ...]

    def __post_init__(self):
        _check_motions(self, self.motions)

    @property
    def duration(self) -> float:
        return max(m.duration for m in self.motions)

    def pose(self, t_s: Times) -> Pose:
        pose = Pose()
        for motion in self.motions:
            pose = pose.displaced(motion.pose(t_s))
        return pose
