"""The lead of the simulation over real time: as long as it likes, but no longer than needed once commands come."""

import pytest

from tests.emulator.test_loop import MS, LateClock, Ramp, make


@pytest.mark.parametrize(("look_ahead_ns", "lead_ms"), [(None, 10.0), (2 * MS, 0.4), (0, 0.4)])
def test_where_commands_come_steps_are_taken_as_late_as_they_may(look_ahead_ns, lead_ms):
    """A step takes 0.1 ms: no sample is late."""
    clock, leads = LateClock(), []

    class Stepped(Ramp):
        def advance_to(self, t_ns, max_steps=None):
            if t_ns >= self.time_ns + self.dt_ns:
                leads.append((t_ns - clock.now_ns()) / MS)
                clock.set_ns(clock.now_ns() + MS // 10)
            return super().advance_to(t_ns)

    emulator, _, channel = make(clock, ramp=Stepped())
    emulator.look_ahead_ns = look_ahead_ns
    with emulator:
        emulator.run(seconds=0.1)
    assert max(leads[10:]) == pytest.approx(lead_ms, abs=1.0 if look_ahead_ns is None else 1e-6)
    assert channel.statistics.lateness.max_ns == 0 and channel.statistics.missed == 0
