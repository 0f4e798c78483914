"""Motors in closed form, so that a hand's driver can move joints. They are no model of a real drive.

A joint that goes to a position moves at its speed limit while it is far away, then approaches with its time constant:

    speed = min(distance / time_constant, speed_limit)

so a time constant of 0 is a constant speed, and no limit is a pure first-order lag. A joint that is driven at a speed
reaches that speed with the same time constant. Both end at the joint's stops. The position at a time follows from the
last order alone, so it does not depend on how often it is read.

Where a physics engine moves the hand (:meth:`Motors.follow_engine`), the joints have the engine's positions, and the
positions above are the setpoints of their controllers (:meth:`Motors.setpoints`): a spring from the joint to the
setpoint, with limited force. A joint that stands still while its motor is at its force limit has stalled.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

STALL_NS = 100_000_000
"""The time after which a joint that stands still at its motor's force limit has stalled."""
MAX_STANDING_SPEED = 0.02
"""The largest speed of a joint that counts as standing still [ranges per second]."""
MIN_FULL_FORCE = 0.98
"""The smallest share of its force limit at which a motor counts as being at the limit."""


class Setpoints(NamedTuple):
    """The setpoints and gains of the controllers of n joints, for an engine: SI, each of shape ``(n,)``."""

    positions: np.ndarray
    """The positions at which they hold the joints [rad, m]."""
    speeds: np.ndarray
    """The speeds of those positions [rad/s, m/s]."""
    forces: np.ndarray
    """The forces of joints that are driven by force alone [Nm, N]; else NaN."""
    max_forces: np.ndarray
    """The force limits [Nm, N]."""
    stiffness: np.ndarray
    """The force per distance of the joint from its setpoint [Nm/rad, N/m]."""


class Motors:
    """The motors of n joints in the units of the device: positions [rad, deg, m or counts], speeds in that per second.

    Args:
        start: positions at power-up, shape ``(n,)``.
        low, high: stops.
        time_constant_s: time constant of the approach; 0: none.
        speed_limit: one for each joint or one for all; see also :meth:`limit_speed`.
        names: names of the joints, so that an engine can move them: those of :meth:`Device.joints`.
        unit: [rad, m] for each of the device's units; negative where the directions are opposite.
        zero: position at which the joint is at 0 rad, 0 m.
        strength: largest force of each motor [Nm, N].
        deflection: distance of a joint from its setpoint at the largest force [rad, m].
    """

    def __init__(
        self,
        start: ArrayLike,
        *,
        low: ArrayLike = -np.inf,
        high: ArrayLike = np.inf,
        time_constant_s: float = 0.1,
        speed_limit: ArrayLike = np.inf,
        names: Sequence[str] = (),
        unit: ArrayLike = 1.0,
        zero: ArrayLike = 0.0,
        strength: ArrayLike = 1.0,
        deflection: float = 0.1,
    ):
        start = np.atleast_1d(np.array(start, float))
        n = len(start)
        self.low, self.high = np.broadcast_to(low, n).astype(float), np.broadcast_to(high, n).astype(float)
        self.time_constant_s = time_constant_s
        self.goals = start.copy()
        """The positions to which the joints go or are driven, shape ``(n,)``."""
        self.stalled = np.zeros(n, bool)
        """True for joints that a load held when it was last computed, and that have had no new order since."""
        self._speed_limit = np.broadcast_to(speed_limit, n).astype(float)
        self._start, self._start_speed = start, np.zeros(n)
        self._driven = np.full(n, np.nan)
        self._since_ns = 0
        self._asked_ns, self._answer = -1, (start, np.zeros(n))
        self.names = tuple(names)
        self._unit, self._zero = (np.broadcast_to(given, n).astype(float) for given in (unit, zero))
        self.strength = np.broadcast_to(strength, n).astype(float)
        self._stiffness = self.strength / deflection
        self._max_forces, self._force_orders = self.strength.copy(), np.full(n, np.nan)
        self._has_order = False
        self._actual: tuple[np.ndarray, np.ndarray] | None = None
        """The positions and speeds in the engine."""
        self.forces = np.zeros(n)
        """The motors' forces in the engine [Nm, N], positive in the direction of rad and m."""
        self._free_ns = np.zeros(n, np.int64)
        """The time at which each joint last moved, or its motor was below its force limit."""

    # -- orders ----------------------------------------------------------------------------------------------------

    def go(self, goals: ArrayLike, t_ns: int, *, at: Any = ...) -> None:
        """Go to these positions from ``t_ns`` on; NaN leaves a joint's order as it is, and so do joints not ``at``."""
        self._settle(t_ns)
        self._has_order = True
        goals = self._of(goals, at)
        given = ~np.isnan(goals)
        self._driven = np.where(given, np.nan, self._driven)
        self.stalled = self.stalled & ~given
        self.goals = np.where(given, np.clip(goals, self.low, self.high), self.goals)
        self._force_orders = np.where(given, np.nan, self._force_orders)

    def drive(self, speeds: ArrayLike, t_ns: int, *, at: Any = ...) -> None:
        """Move at these speeds until the stops; NaN leaves a joint's order as it is, and so do joints not ``at``."""
        self._settle(t_ns)
        self._has_order = True
        speeds = self._of(speeds, at)
        self.stalled = self.stalled & np.isnan(speeds)
        self._driven = np.where(np.isnan(speeds), self._driven, np.clip(speeds, -self._speed_limit, self._speed_limit))
        self.goals = np.where(np.isnan(speeds), self.goals, np.where(speeds > 0, self.high, self.low))
        self._force_orders = np.where(np.isnan(speeds), self._force_orders, np.nan)

    def _of(self, values: ArrayLike, at: Any) -> np.ndarray:
        """Return these values for the joints ``at`` an index, and NaN for all others."""
        found = np.full(self.goals.shape, np.nan)
        found[at] = values
        return found

    def hold(self, t_ns: int) -> None:
        """Stay at the current positions; in an engine, at the current setpoints."""
        self.go(self._state(t_ns)[0], t_ns)

    def limit_speed(self, speed_limit: ArrayLike, t_ns: int) -> None:
        """Set the speed limit from ``t_ns`` on."""
        self._settle(t_ns)
        self._speed_limit = np.broadcast_to(speed_limit, self.goals.shape).astype(float)

    def apply_loads(self, loads: ArrayLike, strengths: ArrayLike, t_ns: int) -> None:
        """Apply external loads from ``t_ns`` on; a joint stands still under an opposing load of its strength or more.

        Args:
            loads: forces in the direction in which positions grow, in the unit of ``strengths`` [N, Nm].
            strengths: largest load that each joint can overcome, at least 0.
            t_ns: current time.

        Where an engine moves the joints, it applies the loads, and this does nothing.
        """
        if self._actual is not None:
            return
        self._settle(t_ns)
        wanted = np.sign(np.where(np.isnan(self._driven), self.goals - self._start, self._driven))
        self.stalled = (wanted != 0) & (-wanted * np.asarray(loads, float) >= strengths)
        self._start_speed = np.where(self.stalled, 0.0, self._start_speed)

    # -- in an engine ----------------------------------------------------------------------------------------------

    @property
    def is_in_engine(self) -> bool:
        """True while an engine moves the joints."""
        return self._actual is not None

    @property
    def travel(self) -> tuple[np.ndarray, np.ndarray]:
        """The stops [rad, m], the lower first."""
        ends = self._si(np.stack([self.low, self.high]))
        return ends.min(axis=0), ends.max(axis=0)

    def drive_by_force(self, forces: ArrayLike, t_ns: int) -> None:
        """Drive joints by force alone [Nm, N], with effect in an engine only; NaN leaves a joint's order as it is."""
        self._settle(t_ns)
        self._has_order = True
        forces = np.broadcast_to(np.asarray(forces, float), self.goals.shape)
        self.stalled = self.stalled & np.isnan(forces)
        self._force_orders = np.where(np.isnan(forces), self._force_orders, forces)

    def limit_force(self, shares: ArrayLike) -> None:
        """Limit the motors' forces to these shares of their strength, 0..1."""
        self._max_forces = np.clip(shares, 0.0, 1.0) * self.strength

    def setpoints(self, t_ns: int) -> Setpoints:
        """Return the setpoints of the controllers at ``t_ns``."""
        positions, speeds = self._state(t_ns)
        return Setpoints(
            self._si(positions), speeds * self._unit, self._force_orders, self._max_forces, self._stiffness
        )

    def follow_engine(self, positions: ArrayLike, speeds: ArrayLike, forces: ArrayLike, t_ns: int) -> None:
        """Set the joints' positions and speeds and the motors' forces to those in an engine: SI, shape ``(n,)``.

        At the first call joints hold the engine's positions, unless they have an order.
        """
        is_first = self._actual is None
        here = np.asarray(positions, float) / self._unit + self._zero
        self._actual = here, np.asarray(speeds, float) / self._unit
        self.forces = np.asarray(forces, float)
        if is_first:
            self._since_ns, self._free_ns = t_ns, np.full(len(here), t_ns)
            self._start, self._start_speed = here, np.zeros_like(here)
            if not self._has_order:
                self.goals, self._driven = np.clip(here, self.low, self.high), np.full(len(here), np.nan)
            self._asked_ns = -1
        span = np.minimum(self.high - self.low, np.abs(2 * np.pi / self._unit))
        is_still = np.abs(self._actual[1]) < MAX_STANDING_SPEED * span
        is_at_limit = (self._max_forces > 0) & (np.abs(self.forces) >= MIN_FULL_FORCE * self._max_forces)
        self._free_ns = np.where(is_still & is_at_limit, self._free_ns, t_ns)
        self.stalled = t_ns - self._free_ns >= STALL_NS

    def loads(self) -> np.ndarray:
        """Return the loads on the joints in an engine, in the direction in which positions grow [Nm, N]."""
        return -self.forces * np.sign(self._unit)

    def leave_engine(self) -> None:
        """Forget the engine's state, before it starts again; :meth:`follow_engine` then begins anew."""
        self._actual, self._has_order = None, False

    def _si(self, positions: np.ndarray) -> np.ndarray:
        return (positions - self._zero) * self._unit

    # -- positions -------------------------------------------------------------------------------------------------

    def positions(self, t_ns: int) -> np.ndarray:
        """Return the positions at ``t_ns``, shape ``(n,)``."""
        return self._state(t_ns)[0] if self._actual is None else self._actual[0]

    def velocities(self, t_ns: int) -> np.ndarray:
        """Return the speeds at ``t_ns``, shape ``(n,)``."""
        return self._state(t_ns)[1] if self._actual is None else self._actual[1]

    def joints(self, t_ns: int) -> dict[str, float]:
        """Return the positions of the joints by name [rad, m]."""
        return dict(zip(self.names, self._si(self.positions(t_ns)).tolist()))

    def moving(self, t_ns: int, tolerance: float = 1e-3) -> np.ndarray:
        """Return True for each joint more than ``tolerance`` from its goal that no load holds, shape ``(n,)``."""
        return (np.abs(self.goals - self.positions(t_ns)) > tolerance) & ~self.stalled & (self._driven != 0)

    def _settle(self, t_ns: int) -> None:
        """Compute the positions from the present state from now on, before a new order."""
        self._start, self._start_speed = self._state(t_ns)
        if self._actual is not None:  # the setpoint leads the joint by no more than the force limit allows
            ahead = self._max_forces / self._stiffness / np.abs(self._unit)
            self._start = np.clip(self._start, self._actual[0] - ahead, self._actual[0] + ahead)
        self._since_ns = max(t_ns, self._since_ns)
        self._asked_ns = -1

    def _state(self, t_ns: int) -> tuple[np.ndarray, np.ndarray]:
        """Return positions and speeds, computed once for each time, as they are read often."""
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
        """Return positions and speeds on the way to the goals.

        Joints move at the limit as far as ``limit * time_constant`` before the goals, then exponentially.
        """
        away = self.goals - self._start
        if not away.any():
            return self._start, np.zeros_like(away)
        distance, tau = np.abs(away), self.time_constant_s
        slow = np.minimum(self._speed_limit * tau, distance) if tau > 0 else np.zeros_like(distance)
        fast = distance - slow
        with np.errstate(divide="ignore", invalid="ignore"):
            until = np.where(fast > 0, fast / self._speed_limit, 0.0)
        cruising = seconds < until
        left = slow * np.exp(-np.maximum(seconds - until, 0.0) / tau) if tau > 0 else slow
        remaining = np.where(cruising, distance - np.where(cruising, self._speed_limit, 0.0) * seconds, left)
        speed = np.where(cruising, self._speed_limit, left / tau if tau > 0 else 0.0)
        return self.goals - np.sign(away) * remaining, np.sign(away) * speed

    def _turn(self, driven: np.ndarray, seconds: float) -> tuple[np.ndarray, np.ndarray]:
        """Return positions and speeds of joints that approach the speeds ``driven``, as far as the stops."""
        tau = self.time_constant_s
        left = np.exp(-seconds / tau) if tau > 0 else 0.0
        missing = self._start_speed - driven
        moved = self._start + driven * seconds + missing * tau * (1 - left)
        positions = np.minimum(np.maximum(moved, self.low), self.high)
        return positions, np.where(positions == moved, driven + missing * left, 0.0)
