"""Motors in closed form, so that a hand's driver has something to drive. Not a model of a real drive.

A joint that goes to a position moves at its speed limit while it is far, and then approaches with its time constant:

    speed = min(distance / time_constant, speed_limit)

so a time constant of 0 is a constant speed, and no limit is a pure first-order lag. A joint that is driven at a speed
takes that speed on with the same time constant. Both end at the joint's stops. Where a joint is at a time follows from
the last order alone, so it does not matter how often somebody asks.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


class Motors:
    """Joints in the units of the device: positions [rad, deg, m or counts], speeds in that per second.

    Args:
        rest: positions at power-up, shape ``(n,)``.
        low, high: stops.
        time_constant_s: of the approach; 0: none.
        speed_limit: by joint or of all; see also :attr:`speed_limit`.
    """

    def __init__(
        self,
        rest: ArrayLike,
        *,
        low: ArrayLike = -np.inf,
        high: ArrayLike = np.inf,
        time_constant_s: float = 0.1,
        speed_limit: ArrayLike = np.inf,
    ):
        start = np.atleast_1d(np.array(rest, float))
        n = len(start)
        self.low, self.high = np.broadcast_to(low, n).astype(float), np.broadcast_to(high, n).astype(float)
        self.time_constant_s = time_constant_s
        self.goals = start.copy()
        """Where the joints go, or are driven to, shape ``(n,)``."""
        self.stalled = np.zeros(n, bool)
        """Joints that a load held when it was last looked at, and that have no new order since."""
        self._limit = np.broadcast_to(speed_limit, n).astype(float)
        self._start, self._start_speed = start, np.zeros(n)
        self._driven = np.full(n, np.nan)
        self._since_ns = 0
        self._asked_ns, self._answer = -1, (start, np.zeros(n))

    # -- orders ----------------------------------------------------------------------------------------------------

    def go(self, goals: ArrayLike, t_ns: int) -> None:
        """Go to these positions from ``t_ns`` on; NaN leaves a joint to what it does."""
        self._settle(t_ns)
        goals = np.broadcast_to(np.asarray(goals, float), self.goals.shape)
        given = ~np.isnan(goals)
        self._driven = np.where(given, np.nan, self._driven)
        self.stalled = self.stalled & ~given
        self.goals = np.where(given, np.clip(goals, self.low, self.high), self.goals)

    def drive(self, speeds: ArrayLike, t_ns: int) -> None:
        """Move at these speeds until the stops; NaN leaves a joint to what it does."""
        self._settle(t_ns)
        speeds = np.broadcast_to(np.asarray(speeds, float), self.goals.shape)
        self.stalled = self.stalled & np.isnan(speeds)
        self._driven = np.where(np.isnan(speeds), self._driven, np.clip(speeds, -self._limit, self._limit))
        self.goals = np.where(np.isnan(speeds), self.goals, np.where(speeds > 0, self.high, self.low))

    def hold(self, t_ns: int) -> None:
        """Stay where they are."""
        self.go(self.positions(t_ns), t_ns)

    def limit_speed(self, speed_limit: ArrayLike, t_ns: int) -> None:
        """Another speed limit from ``t_ns`` on."""
        self._settle(t_ns)
        self._limit = np.broadcast_to(speed_limit, self.goals.shape).astype(float)

    def load(self, loads: ArrayLike, strengths: ArrayLike, t_ns: int) -> None:
        """What pushes on the joints since ``t_ns``; one that is pushed back by its strength or more stands.

        Args:
            loads: in the direction in which positions grow, in the unit of ``strengths`` [N, Nm].
            strengths: what each joint can overcome, at least 0.
            t_ns: now.
        """
        self._settle(t_ns)
        wanted = np.sign(np.where(np.isnan(self._driven), self.goals - self._start, self._driven))
        self.stalled = (wanted != 0) & (-wanted * np.asarray(loads, float) >= strengths)
        self._start_speed = np.where(self.stalled, 0.0, self._start_speed)

    # -- where they are --------------------------------------------------------------------------------------------

    def positions(self, t_ns: int) -> np.ndarray:
        """Shape ``(n,)``."""
        return self._state(t_ns)[0]

    def velocities(self, t_ns: int) -> np.ndarray:
        """Shape ``(n,)``."""
        return self._state(t_ns)[1]

    def moving(self, t_ns: int, tolerance: float = 1e-3) -> np.ndarray:
        """Whether a joint has more than ``tolerance`` to go and no load holds it, shape ``(n,)``."""
        return (np.abs(self.goals - self.positions(t_ns)) > tolerance) & ~self.stalled & (self._driven != 0)

    def _settle(self, t_ns: int) -> None:
        """An order is coming: from here on where they are follows from here."""
        self._start, self._start_speed = self._state(t_ns)
        self._since_ns = max(t_ns, self._since_ns)
        self._asked_ns = -1

    def _state(self, t_ns: int) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities; asked for often at one time, computed once."""
        if t_ns == self._asked_ns:
            return self._answer
        self._answer, self._asked_ns = self._follow(t_ns), t_ns
        return self._answer

    def _follow(self, t_ns: int) -> tuple[np.ndarray, np.ndarray]:
        seconds = max(t_ns - self._since_ns, 0) * 1e-9
        driven = ~np.isnan(self._driven)
        if driven.all():
            positions, speeds = self._turn(self._driven, seconds)
        else:
            positions, speeds = self._approach(seconds)
            if driven.any():
                turning, turning_speeds = self._turn(np.where(driven, self._driven, 0.0), seconds)
                positions, speeds = np.where(driven, turning, positions), np.where(driven, turning_speeds, speeds)
        return np.where(self.stalled, self._start, positions), np.where(self.stalled, 0.0, speeds)

    def _approach(self, seconds: float) -> tuple[np.ndarray, np.ndarray]:
        """Towards the goals: at the limit as far as ``limit * time_constant`` before them, then exponentially."""
        away = self.goals - self._start
        if not away.any():
            return self._start, np.zeros_like(away)
        distance, tau = np.abs(away), self.time_constant_s
        slow = np.minimum(self._limit * tau, distance) if tau > 0 else np.zeros_like(distance)
        fast = distance - slow
        with np.errstate(divide="ignore", invalid="ignore"):
            until = np.where(fast > 0, fast / self._limit, 0.0)
        cruising = seconds < until
        left = slow * np.exp(-np.maximum(seconds - until, 0.0) / tau) if tau > 0 else slow
        remaining = np.where(cruising, distance - np.where(cruising, self._limit, 0.0) * seconds, left)
        speed = np.where(cruising, self._limit, left / tau if tau > 0 else 0.0)
        return self.goals - np.sign(away) * remaining, np.sign(away) * speed

    def _turn(self, driven: np.ndarray, seconds: float) -> tuple[np.ndarray, np.ndarray]:
        """At the speeds that they are driven at, taken on exponentially, as far as the stops."""
        tau = self.time_constant_s
        left = np.exp(-seconds / tau) if tau > 0 else 0.0
        missing = self._start_speed - driven
        moved = self._start + driven * seconds + missing * tau * (1 - left)
        positions = np.minimum(np.maximum(moved, self.low), self.high)
        return positions, np.where(positions == moved, driven + missing * left, 0.0)
