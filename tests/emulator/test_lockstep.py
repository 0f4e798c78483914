"""Time that advances only when it is told to: the bytes of time that runs by itself, and answers while it stands."""

import functools

import pytest

from firmware_protocols.frames import frame_of
from tactemu.base.clock import LockstepClock, VirtualClock
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene import file
from tactemu.truth import Truth

MS = 1_000_000


def emulator_of(device: str, clock, **options):
    truth = Truth()
    made = assemble(
        file.load(device, options), AssemblyOptions(port="memory:", seed=3), clock=clock, truth=truth
    ).emulator
    return made, truth


def go_on(emulator, until_ns: int) -> None:
    """What a controller in the same thread does: let time pass, and turn until it stands again."""
    emulator.clock.go_on(until_ns)
    while not emulator.clock.is_paused():
        emulator.step()


def ask(emulator, write) -> None:
    """Every documented request at a virtual time of its own; of a bus that is switched on and off, the former."""
    commands = [command for command in emulator.channels[0].device.commands if command.name != "stop"]
    for k, command in enumerate(commands):
        for j, request in enumerate((*command.after, *command.written)):
            emulator.at(round((20.3 + 7.1 * k + 1.7 * j) * MS), functools.partial(write, frame_of(request)))


def test_a_deadline_of_the_past_does_not_turn_time_back():
    clock = VirtualClock(5)
    for deadline, now in ((50, 50), (20, 50), (None, 50), (51, 51)):
        clock.wait(deadline, [])
        assert clock.now_ns() == now


def test_time_goes_on_to_its_end_and_no_further():
    clock = LockstepClock(5)
    clock.go_on(50)
    for deadline, now in ((20, 20), (80, 50)):
        clock.wait(deadline, [])
        assert clock.now_ns() == now and not clock.is_paused()
    clock.wait(80, [])
    assert clock.is_paused() and clock.now_ns() == 50
    clock.go_on(60)
    assert not clock.is_paused()
    clock.wait(None, [])
    assert clock.now_ns() == 60


def test_an_earlier_end_changes_nothing():
    clock = LockstepClock()
    clock.go_on(50)
    clock.go_on(20)
    assert clock.end_ns == 50
    clock.wait(80, [])
    clock.go_on(20)
    assert clock.end_ns == 50 and clock.now_ns() == 50
    clock.wait(80, [])
    assert clock.is_paused()
    clock.go_on(50)
    assert clock.is_paused(), "the time at which it pauses is not later than before"


# a stream, a bus, one that is polled on a shared line, one that is polled and streams
@pytest.mark.parametrize("device", ["anyskin", "xela_uskin", "brainco_revo2", "paxini_gen2"])
def test_a_thousand_steps_give_the_bytes_of_virtual_time(device):
    logs = []
    for clock in (VirtualClock(), LockstepClock()):
        emulator, truth = emulator_of(device, clock)
        with emulator:
            ask(emulator, emulator.channels[0].wire.transport.driver.write)  # pyright: ignore
            if isinstance(clock, LockstepClock):
                for k in range(1000):
                    go_on(emulator, (k + 1) * MS)
            else:
                emulator.run(1.0)
                emulator.step()
        logs.append((truth.frames, [(s.t_ns, s.counts.tobytes()) for s in truth.samples]))
    assert logs[0] == logs[1]
    assert logs[0][0], "nothing was sent"
