"""Six motors that answer plausibly, so that a hand's driver has something to drive. Not a model of the real drive.

Each joint follows its command with one time constant: towards a position, or towards a velocity that is commanded
directly or follows from a current or a duty cycle. Everything is in closed form, so the steps may have any length.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

JOINTS = ("index", "middle", "ring", "pinky", "thumb flexor", "thumb rotator")
LOWEST = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -100.0])
HIGHEST = np.array([100.0, 100.0, 100.0, 100.0, 100.0, 0.0])
REST = np.array([15.0, 15.0, 15.0, 15.0, 15.0, -15.0])

TIME_CONSTANT_S = 0.1
SPEED_PER_AMPERE = 200.0
SPEED_AT_FULL_DUTY = 300.0

Mode = Literal["position", "velocity", "current", "duty"]


class Motors:
    """Angles [deg], velocities [deg/s] and currents [A] of the joints in the order of :data:`JOINTS`."""

    def __init__(self):
        self.positions = REST.copy()
        self.velocities = np.zeros(6)
        self._mode: Mode = "position"
        self._target = REST.copy()
        self._now_ns = 0

    @property
    def currents(self) -> np.ndarray:
        """What keeps the joints moving; the commanded current in that mode, even at the stop."""
        return self._target if self._mode == "current" else self.velocities / SPEED_PER_AMPERE

    def command(self, mode: Mode, target: np.ndarray, t_ns: int) -> None:
        """Follow ``target`` [deg, deg/s, A, or -1..1] from ``t_ns`` on."""
        self.advance(t_ns)
        self._mode = mode
        self._target = np.clip(target, LOWEST, HIGHEST) if mode == "position" else np.asarray(target, float)

    def hold(self, t_ns: int) -> None:
        """Stay where you are."""
        self.advance(t_ns)
        self.command("position", self.positions, t_ns)

    def advance(self, t_ns: int) -> None:
        """Move on to ``t_ns``."""
        dt = max(t_ns - self._now_ns, 0) * 1e-9
        self._now_ns = max(t_ns, self._now_ns)
        left = np.exp(-dt / TIME_CONSTANT_S)
        if self._mode == "position":
            self.positions = self._target + (self.positions - self._target) * left
            self.velocities = (self._target - self.positions) / TIME_CONSTANT_S
            return
        scale = {"velocity": 1.0, "current": SPEED_PER_AMPERE, "duty": SPEED_AT_FULL_DUTY}[self._mode]
        goal = self._target * scale
        missing = self.velocities - goal
        moved = self.positions + goal * dt + missing * TIME_CONSTANT_S * (1 - left)
        self.positions = np.clip(moved, LOWEST, HIGHEST)
        self.velocities = np.where(moved == self.positions, goal + missing * left, 0.0)
