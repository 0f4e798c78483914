"""Motors in closed form, so that a hand's driver has something to drive. Not a model of a real drive.

A joint that goes to a position moves at its speed limit while it is far, and then approaches with its time constant:

    speed = min(distance / time_constant, speed_limit)

so a time constant of 0 is a constant speed, and no limit is a pure first-order lag. A joint that is driven at a speed
takes that speed on with the same time constant. Both end at the joint's stops. Where a joint is at a time follows from
the last order alone, so it does not matter how often somebody asks.

Where a physics engine moves the hand (:meth:`Motors.moved`), joints are where the engine has them, and what is above is
what their controllers want (:meth:`Motors.wants`): a spring from the joint to that place, its force limited. A joint
that stands while its motor does all that it may has stalled.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

STALL_NS = 100_000_000
"""A joint that stands for so long while its motor does all that it may has stalled."""
STANDING, ALL = 0.02, 0.98
"""Slower than this share of its range in a second a joint stands; from this share of its limit on a motor does all."""


class Wants(NamedTuple):
    """What the controllers of n joints do, for an engine: SI, each of shape ``(n,)``."""

    positions: np.ndarray
    """Where they hold the joints [rad, m]."""
    speeds: np.ndarray
    """Of that place [rad/s, m/s]."""
    forces: np.ndarray
    """Of joints that are driven by force alone [Nm, N]; else NaN."""
    most: np.ndarray
    """Their force is at most this [Nm, N]."""
    stiffness: np.ndarray
    """Force per distance from where they hold the joint [Nm/rad, N/m]."""


class Motors:
    """Joints in the units of the device: positions [rad, deg, m or counts], speeds in that per second.

    Args:
        rest: positions at power-up, shape ``(n,)``.
        low, high: stops.
        time_constant_s: of the approach; 0: none.
        speed_limit: by joint or of all; see also :attr:`speed_limit`.
        names: of the joints, so that an engine can move them: those of :meth:`Device.joints`.
        unit: [rad, m] for each of the device's units; its sign says which way is positive.
        zero: position at which the joint is at 0 rad, 0 m.
        strength: the most that each motor can do [Nm, N].
        give: how far a joint is from where it should be when its motor does all it can [rad, m].
    """

    def __init__(
        self,
        rest: ArrayLike,
        *,
        low: ArrayLike = -np.inf,
        high: ArrayLike = np.inf,
        time_constant_s: float = 0.1,
        speed_limit: ArrayLike = np.inf,
        names: Sequence[str] = (),
        unit: ArrayLike = 1.0,
        zero: ArrayLike = 0.0,
        strength: ArrayLike = 1.0,
        give: float = 0.1,
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
        self.names = tuple(names)
        self._unit, self._zero = (np.broadcast_to(given, n).astype(float) for given in (unit, zero))
        self.strength = np.broadcast_to(strength, n).astype(float)
        self._stiffness = self.strength / give
        self._most, self._pushed = self.strength.copy(), np.full(n, np.nan)
        self._ordered = False
        self._actual: tuple[np.ndarray, np.ndarray] | None = None
        """Positions and speeds as an engine has them."""
        self.forces = np.zeros(n)
        """What the motors do in an engine [Nm, N], positive where it moves the joint along rad and m."""
        self._free_ns = np.zeros(n, np.int64)
        """When each joint last moved, or its motor did less than it may."""

    # -- orders ----------------------------------------------------------------------------------------------------

    def go(self, goals: ArrayLike, t_ns: int) -> None:
        """Go to these positions from ``t_ns`` on; NaN leaves a joint to what it does."""
        self._settle(t_ns)
        self._ordered = True
        goals = np.broadcast_to(np.asarray(goals, float), self.goals.shape)
        given = ~np.isnan(goals)
        self._driven = np.where(given, np.nan, self._driven)
        self.stalled = self.stalled & ~given
        self.goals = np.where(given, np.clip(goals, self.low, self.high), self.goals)
        self._pushed = np.where(given, np.nan, self._pushed)

    def drive(self, speeds: ArrayLike, t_ns: int) -> None:
        """Move at these speeds until the stops; NaN leaves a joint to what it does."""
        self._settle(t_ns)
        self._ordered = True
        speeds = np.broadcast_to(np.asarray(speeds, float), self.goals.shape)
        self.stalled = self.stalled & np.isnan(speeds)
        self._driven = np.where(np.isnan(speeds), self._driven, np.clip(speeds, -self._limit, self._limit))
        self.goals = np.where(np.isnan(speeds), self.goals, np.where(speeds > 0, self.high, self.low))
        self._pushed = np.where(np.isnan(speeds), self._pushed, np.nan)

    def hold(self, t_ns: int) -> None:
        """Stay where they are; in an engine, where they are held."""
        self.go(self._state(t_ns)[0], t_ns)

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

        In an engine joints meet their loads there, and this does nothing.
        """
        if self._actual is not None:
            return
        self._settle(t_ns)
        wanted = np.sign(np.where(np.isnan(self._driven), self.goals - self._start, self._driven))
        self.stalled = (wanted != 0) & (-wanted * np.asarray(loads, float) >= strengths)
        self._start_speed = np.where(self.stalled, 0.0, self._start_speed)

    # -- in an engine ----------------------------------------------------------------------------------------------

    @property
    def embodied(self) -> bool:
        """Whether an engine moves the joints."""
        return self._actual is not None

    @property
    def travel(self) -> tuple[np.ndarray, np.ndarray]:
        """The stops [rad, m], the lower first."""
        ends = self._si(np.stack([self.low, self.high]))
        return ends.min(axis=0), ends.max(axis=0)

    def push(self, forces: ArrayLike, t_ns: int) -> None:
        """Drive joints by force alone [Nm, N]; NaN leaves one to what it does. Only in an engine that has an effect."""
        self._settle(t_ns)
        self._ordered = True
        forces = np.broadcast_to(np.asarray(forces, float), self.goals.shape)
        self.stalled = self.stalled & np.isnan(forces)
        self._pushed = np.where(np.isnan(forces), self._pushed, forces)

    def limit_force(self, shares: ArrayLike) -> None:
        """Let motors do at most these shares of their strength, 0..1."""
        self._most = np.clip(shares, 0.0, 1.0) * self.strength

    def wants(self, t_ns: int) -> Wants:
        """What the controllers do at ``t_ns``."""
        positions, speeds = self._state(t_ns)
        return Wants(self._si(positions), speeds * self._unit, self._pushed, self._most, self._stiffness)

    def moved(self, positions: ArrayLike, speeds: ArrayLike, forces: ArrayLike, t_ns: int) -> None:
        """Take over what the joints did in an engine, and what their motors did there: SI, shape ``(n,)``.

        Joints hold still where the engine has them when it begins, unless they have been told to go elsewhere.
        """
        begins = self._actual is None
        here = np.asarray(positions, float) / self._unit + self._zero
        self._actual = here, np.asarray(speeds, float) / self._unit
        self.forces = np.asarray(forces, float)
        if begins:
            self._since_ns, self._free_ns = t_ns, np.full(len(here), t_ns)
            self._start, self._start_speed = here, np.zeros_like(here)
            if not self._ordered:
                self.goals, self._driven = np.clip(here, self.low, self.high), np.full(len(here), np.nan)
            self._asked_ns = -1
        span = np.minimum(self.high - self.low, np.abs(2 * np.pi / self._unit))
        at_rest = np.abs(self._actual[1]) < STANDING * span
        does_all = (self._most > 0) & (np.abs(self.forces) >= ALL * self._most)
        self._free_ns = np.where(at_rest & does_all, self._free_ns, t_ns)
        self.stalled = t_ns - self._free_ns >= STALL_NS

    def loads(self) -> np.ndarray:
        """What pushes on the joints in an engine, in the direction in which positions grow [Nm, N]."""
        return -self.forces * np.sign(self._unit)

    def released(self) -> None:
        """The engine starts anew: where it has the joints is taken over again."""
        self._actual, self._ordered = None, False

    def _si(self, positions: np.ndarray) -> np.ndarray:
        return (positions - self._zero) * self._unit

    # -- where they are --------------------------------------------------------------------------------------------

    def positions(self, t_ns: int) -> np.ndarray:
        """Shape ``(n,)``."""
        return self._state(t_ns)[0] if self._actual is None else self._actual[0]

    def velocities(self, t_ns: int) -> np.ndarray:
        """Shape ``(n,)``."""
        return self._state(t_ns)[1] if self._actual is None else self._actual[1]

    def joints(self, t_ns: int) -> dict[str, float]:
        """Return the joints by their names [rad, m]."""
        return dict(zip(self.names, self._si(self.positions(t_ns)).tolist()))

    def moving(self, t_ns: int, tolerance: float = 1e-3) -> np.ndarray:
        """Whether a joint has more than ``tolerance`` to go and no load holds it, shape ``(n,)``."""
        return (np.abs(self.goals - self.positions(t_ns)) > tolerance) & ~self.stalled & (self._driven != 0)

    def _settle(self, t_ns: int) -> None:
        """An order is coming: from here on where they are follows from here."""
        self._start, self._start_speed = self._state(t_ns)
        if self._actual is not None:  # no farther ahead of the joint than its motor's force takes
            ahead = self._most / self._stiffness / np.abs(self._unit)
            self._start = np.clip(self._start, self._actual[0] - ahead, self._actual[0] + ahead)
        self._since_ns = max(t_ns, self._since_ns)
        self._asked_ns = -1

    def _state(self, t_ns: int) -> tuple[np.ndarray, np.ndarray]:
        """Return positions and velocities; asked for often at one time, computed once."""
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
        if self._actual is not None:
            return positions, speeds
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
