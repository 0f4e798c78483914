"""The simulation as the loop uses it, and its steps ahead of the next sample while nothing else is due."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from tactemu.base.clock import Clock

if TYPE_CHECKING:
    from tactemu.plan.plan import Plan

MAX_LAG_NS = 10_000_000_000
"""Longest time that the simulation makes up in whole steps; bounds the wait of a sample after a long idle time."""


class Simulated(Protocol):
    """A simulation, as the loop uses it."""

    time_ns: int

    @property
    def plan(self) -> Plan | None:
        """The plan of a step; ``None`` where nothing is simulated."""
        ...

    @property
    def dt_ns(self) -> int:
        """Length of a step."""
        ...

    def advance_to(self, t_ns: int, max_steps: int | None = None) -> bool:
        """Step until no whole step fits before ``t_ns``; return True if a step was stretched to keep ``max_steps``."""
        ...


def step_ahead(simulation: Simulated, clock: Clock, until_ns: int, max_lead_ns: int | None) -> int | None:
    """Take one step of the simulation if it ends by ``until_ns``; return when to call this again, None if not at all.

    In real time the simulation leads the clock by ``max_lead_ns`` at most (or by a step, if that is longer).
    """
    t_ns = simulation.time_ns + simulation.dt_ns
    if t_ns > until_ns:
        return None
    if max_lead_ns is not None and not clock.virtual:
        begin_ns = t_ns - max(max_lead_ns, simulation.dt_ns)
        if begin_ns > clock.now_ns():
            return begin_ns
    simulation.advance_to(t_ns)
    return clock.now_ns()
