"""The loop alone: deadlines, missed samples, commands, order; a recording wire and a made-up device."""

from collections import Counter

import numpy as np
import pytest

from firmware_protocols import Device, Sense, Serial, grid_layout
from tactemu.base.clock import VirtualClock
from tactemu.emulator.emulator import Channel, Emulator
from tactemu.emulator.sampling import SampleClock
from tactemu.transports.transport import Closed, Opened
from tactemu.wire.wire import ReceivedData

MS = 1_000_000


class Counter8(Device):
    """Streams one byte, its sample number; `p` makes it ten times faster, `?` is answered with `!`."""

    name, title, ports, evidence, sources = "counter8", "Counter", (Serial(baud=9600),), ("assumed",), ()
    senses, rate_hz = ("depth",), 100.0

    def __init__(self):
        self.layout = grid_layout(1, 1, 1e-3)
        self.n = 0

    def measure(self, reading, t_ns):
        return np.round(reading["depth"] * 1e6)

    def stream(self, t_ns, name):
        self.n += 1
        return [bytes([self.n & 255])]

    def receive(self, data, t_ns, port):
        if data == b"p":
            self.period_ns = 1_000_000
        return [b"!"] if data == b"?" else []


class ListWire:
    """A wire of infinite speed that remembers."""

    name = ""

    def __init__(self):
        self.sent, self.events, self.opened, self.counters = [], [], 0, Counter()

    def open(self):
        self.opened += 1

    def close(self):
        self.opened = 0

    def attach(self, source, connector):
        pass

    def received_by(self, source, heard):
        return heard.data

    def send(self, frames, now_ns, source="", sample=None):
        self.sent += [(now_ns, source, frame) for frame in frames]

    def next_due_ns(self):
        return None

    def flush(self, now_ns):
        return 0

    def receive(self, now_ns, readable=None):
        events, self.events = self.events, []
        return events

    def filenos(self):
        return []


class Ramp:
    """Depth equal to the time [s]."""

    time_ns = 0
    dt_ns = 1_000_000

    def advance_to(self, t_ns, max_steps=None):
        self.time_ns += max(0, t_ns - self.time_ns) // self.dt_ns * self.dt_ns
        return False

    def read(self, senses, t_ns):
        values = {sense.key: np.array([self.time_ns / 1e9]) for sense in senses}
        return values, values


class LateClock(VirtualClock):
    """A clock of real time that is read without delay; a stall moves it on."""

    virtual = False


def make(clock=None, *, device=None, ramp=None, refresh_ns=0, **sampling):
    wire, ramp, device = ListWire(), ramp or Ramp(), device or Counter8()
    clock_of_device = SampleClock(period_ns=device.period_ns, **sampling)
    channel = Channel("a", device, ramp, {"": wire}, clock_of_device, refresh_ns=refresh_ns)
    return Emulator(ramp, [channel], clock=clock or VirtualClock()), wire, channel


def stall(emulator, from_ms: int, until_ms: int) -> None:
    """Let the machine do something else from one time to another."""
    emulator.at(from_ms * MS, lambda: emulator.clock.set_ns(until_ms * MS))


def sampled_ms(emulator) -> list[float]:
    """Return the times of the samples after that of the boot [ms]."""
    return [sample.t_ns / MS for sample in emulator.truth.samples[1:]]


def test_samples_come_on_absolute_deadlines_and_see_the_simulation_of_that_time():
    emulator, wire, channel = make()
    with emulator:
        emulator.run(seconds=1.0)
    assert [t for t, _, _ in wire.sent] == [k * 10_000_000 for k in range(1, 100)]
    assert [frame[0] for _, _, frame in wire.sent] == list(range(1, 100))
    assert [s.counts[0] for s in emulator.truth.samples][:4] == [0, 10_000, 20_000, 30_000]
    assert channel.statistics.samples == 99 and channel.statistics.missed == 0
    assert channel.statistics.rate_hz == pytest.approx(100.0)


def test_delay_moves_the_frames_not_the_samples():
    emulator, wire, _ = make(delay_ns=3_700_000)
    with emulator:
        emulator.run(seconds=0.1)
    assert [t for t, _, _ in wire.sent][:2] == [13_700_000, 23_700_000]
    assert [s.t_ns for s in emulator.truth.samples][:3] == [0, 10_000_000, 20_000_000]


def test_a_slow_device_samples_late_and_does_not_know():
    """Its clock is 1 % slow: every tenth of a second on ours it shows a period per sample all the same."""
    emulator, wire, channel = make(skew_ppm=10_000.0)
    shown = []
    channel.device.stream = lambda t_ns, name: shown.append(t_ns) or [b"x"]
    channel.device.receive = lambda data, t_ns, port: shown.append(-t_ns) or []
    with emulator:
        emulator.run(seconds=0.5)
        wire.events = [ReceivedData(b"?")]
        emulator.step()
    assert [t for t, _, _ in wire.sent][:3] == [10_100_000, 20_200_000, 30_300_000]
    assert [t for t in shown if t > 0] == [k * 10_000_000 for k in range(1, len(wire.sent) + 1)]
    assert -min(shown) == pytest.approx(0.5e9 / 1.01, abs=2)


def test_a_command_is_answered_and_may_change_the_period():
    emulator, wire, _ = make()
    with emulator:
        wire.events = [Opened(), ReceivedData(b"?")]
        emulator.run(seconds=0.05)
        assert (0, "a", b"!") in wire.sent
        wire.sent.clear()
        wire.events = [ReceivedData(b"p"), Closed()]
        emulator.run(seconds=0.01)
    assert [t for t, _, _ in wire.sent] == [50_000_000 + k * 1_000_000 for k in range(1, 10)]


def test_a_slow_machine_misses_samples_and_says_so():
    class Slow(VirtualClock):
        """Every look at the clock costs 4 ms."""

        def now_ns(self):
            self._now += 4_000_000
            return self._now

    emulator, _, channel = make(clock=Slow())
    with emulator:
        emulator.run(seconds=1.0)
    statistics = channel.statistics
    assert statistics.missed > 0
    assert statistics.samples + statistics.missed == pytest.approx(100, abs=8)
    assert statistics.lateness.max_ns >= 4_000_000


@pytest.mark.parametrize("clock", [VirtualClock, LateClock])
def test_a_stall_misses_the_samples_that_are_late_by_a_period_and_no_other(clock):
    """Stall from 25 to 57 ms: the samples of 30 and 50 ms are late, that of 40 ms is never taken."""
    emulator, _, channel = make(clock())
    stall(emulator, 25, 57)
    with emulator:
        emulator.run(seconds=0.1)
    statistics = channel.statistics
    assert sampled_ms(emulator) == [10, 20, 30, 50, 60, 70, 80, 90]
    assert (statistics.samples, statistics.missed, statistics.silent, statistics.stretched) == (8, 1, 0, 0)
    assert statistics.lateness.max_ns == 27 * MS and statistics.lateness.percentile_ns(50) == 0.0


def test_a_stall_of_many_periods_counts_each_of_them():
    emulator, _, channel = make()
    stall(emulator, 25, 80)
    with emulator:
        emulator.run(seconds=0.1)
    assert sampled_ms(emulator) == [10, 20, 30, 80, 90], "a sample that is due now is not missed"
    assert channel.statistics.missed == 4


def test_only_samples_late_by_a_period_take_few_steps_and_each_is_counted():
    class Steps(Ramp):
        """A simulation that notes the number of steps that a sample may take, and stretches those of few."""

        def __init__(self):
            self.limits = {}

        def advance_to(self, t_ns, max_steps=None):
            super().advance_to(t_ns)
            if max_steps is not None:
                self.limits[t_ns // MS] = max_steps
            return max_steps == 50

    ramp = Steps()
    emulator, _, channel = make(LateClock(), ramp=ramp)
    stall(emulator, 25, 57)
    stall(emulator, 65, 84)
    with emulator:
        emulator.run(seconds=0.1)
    assert [t for t, steps in ramp.limits.items() if steps == 50] == [30, 70]
    assert channel.statistics.stretched == 2
    assert set(ramp.limits.values()) == {50, 10_001}, "ten seconds of whole steps, when in time"


class Counted(Ramp):
    """A simulation that notes the time that it reaches with each call; a call takes ``cost_ns`` of the clock's time."""

    def __init__(self, clock=None, cost_ns=0):
        self.reached_ms, self.clock, self.cost_ns = [], clock, cost_ns

    def advance_to(self, t_ns, max_steps=None):
        before = self.time_ns
        super().advance_to(t_ns)
        if self.time_ns > before:
            self.reached_ms.append(self.time_ns / MS)
            if self.cost_ns:
                self.clock.set_ns(self.clock.now_ns() + self.cost_ns)
        return False


def test_a_turn_takes_all_steps_up_to_what_is_due_next():
    ramp = Counted()
    emulator, _, _ = make(ramp=ramp)
    emulator.at(34 * MS, lambda: None)
    with emulator:
        for _ in range(4):
            emulator.step()
    assert ramp.reached_ms == [10, 20, 30, 34] and emulator.clock.now_ns() == 34 * MS


def test_a_turn_of_a_slow_device_takes_a_bounded_number_of_steps():
    ramp, slow = Counted(), Counter8()
    slow.period_ns = 1000 * MS
    emulator, _, channel = make(ramp=ramp, device=slow)
    with emulator:
        emulator.run(seconds=1.5)
    assert ramp.reached_ms[:3] == [32, 64, 96] and ramp.reached_ms[31] == 1000
    assert channel.statistics.samples == 1


@pytest.mark.parametrize(("cost_ns", "turns"), [(0, 1), (20_000, 4), (60_000, 10)])
def test_in_real_time_a_turn_steps_for_a_short_time_and_looks_at_its_ports_again(cost_ns, turns):
    clock = LateClock()
    ramp = Counted(clock, cost_ns)
    emulator, _, channel = make(clock, ramp=ramp)
    with emulator:
        for _ in range(turns):
            assert ramp.time_ns < 10 * MS
            emulator.step()
    assert ramp.reached_ms == list(range(1, 11)) and channel.statistics.samples == 0


@pytest.mark.parametrize("sample", [1, 3])
def test_a_device_that_changes_its_period_with_a_sample_skips_none(sample):
    class Faster(Counter8):
        def stream(self, t_ns, name):
            sent = super().stream(t_ns, name)
            if self.n == sample:
                self.period_ns = MS
            return sent

    emulator, _, channel = make(device=Faster())
    with emulator:
        emulator.run(seconds=0.001 * (10 * sample + 4))
    assert sampled_ms(emulator) == [*range(10, 10 * sample, 10), *range(10 * sample, 10 * sample + 4)]
    assert channel.statistics.missed == 0


def test_registers_are_refreshed_by_the_devices_own_clock():
    """Let the device's clock be a tenth slow: 24 ms on it are 26.4 ms, so 70 ms on it are still in the third period."""
    emulator, _, _ = make(skew_ppm=100_000.0, refresh_ns=24 * MS)
    with emulator:
        emulator.run(seconds=0.1)
    measured = [round(float(sample.measured[0]) * 1e3) for sample in emulator.truth.samples]
    assert measured == [0, 0, 0, 33, 33, 55, 55, 55, 88, 88]
    assert [round(float(sample.ideal[0]) * 1e3) for sample in emulator.truth.samples] == list(range(0, 100, 11))


def test_a_burst_is_spread_evenly_over_the_period():
    class Bursting(Counter8):
        senses = (Sense("depth", burst=4),)

        def measure(self, reading, t_ns):
            return np.round(reading["depth"] * 1e6)

    class Fine(Ramp):
        dt_ns = 500_000

    emulator, _, channel = make(device=Bursting(), ramp=Fine())
    with emulator:
        emulator.run(seconds=0.031)
    rows = [sample.counts.ravel().tolist() for sample in emulator.truth.samples]
    assert rows == [[0] * 4, *([10_000 * k + 2_500 * j for j in range(1, 5)] for k in range(3))]
    assert channel.statistics.samples == 3


def test_a_firmware_that_leaves_samples_out_takes_the_others_on_time():
    emulator, _, channel = make(missed=0.3, seed=1)
    with emulator:
        emulator.run(seconds=1.0)
    clock = channel.timers[""].sampling
    taken = [k for k in range(1, 100) if clock.first_taken(k) == k]
    assert sampled_ms(emulator) == [10 * k for k in taken] and 50 < len(taken) < 90
    assert channel.statistics.missed == 0, "the loop was in time"


def test_scheduled_and_foreign_actions_run_in_the_loop():
    emulator, _, _ = make()
    seen = []
    emulator.at(25_000_000, lambda: seen.append(emulator.clock.now_ns()))
    emulator.call(lambda: seen.append("called"))
    with emulator:
        emulator.run(seconds=0.05)
    assert seen == ["called", 25_000_000]


def test_a_hanging_device_is_silent_and_goes_on_with_its_grid():
    emulator, wire, channel = make()
    emulator.at(35_000_000, lambda: emulator.hang(75_000_000))
    emulator.at(50_000_000, lambda: wire.events.append(ReceivedData(b"?")))
    with emulator:
        emulator.run(seconds=0.1)
    assert [t // 1_000_000 for t, _, _ in wire.sent] == [10, 20, 30, 80, 90]
    assert channel.statistics.silent == 4 and channel.device.counters["unheard"] == 1
    assert emulator.truth.injected["hang"] == 1


def test_a_hang_ends_at_its_time_and_a_shorter_one_does_not_end_it():
    emulator, _, channel = make()
    emulator.at(35 * MS, lambda: emulator.hang(70 * MS))
    emulator.at(45 * MS, lambda: emulator.hang(55 * MS))
    with emulator:
        emulator.run(seconds=0.1)
    assert sampled_ms(emulator) == [10, 20, 30, 70, 80, 90]
    assert channel.statistics.silent == 3 and channel.statistics.missed == 0


def test_a_reset_device_boots_anew():
    class Booting(Counter8):
        boot_s = 0.025

        def boot(self, t_ns):
            return [b"B"]

    wire, ramp = ListWire(), Ramp()
    channel = Channel("a", Booting(), ramp, {"": wire}, SampleClock(period_ns=10_000_000))
    emulator = Emulator(ramp, [channel], clock=VirtualClock())
    emulator.at(52_000_000, emulator.reset)
    with emulator:
        emulator.run(seconds=0.1)
    ms = [(t // 1_000_000, frame) for t, _, frame in wire.sent]
    assert ms == [(25, b"B"), (35, b"\x01"), (45, b"\x02"), (77, b"B"), (87, b"\x01"), (97, b"\x02")]


def test_a_port_that_fails_closes_those_already_open():
    class Broken(ListWire):
        def open(self):
            raise OSError("no")

    good, bad = ListWire(), Broken()
    channels = [Channel(n, Counter8(), Ramp(), {"": w}, SampleClock(period_ns=1)) for n, w in (("a", good), ("b", bad))]
    with pytest.raises(OSError):
        Emulator(None, channels).open()
    assert good.opened == 0
