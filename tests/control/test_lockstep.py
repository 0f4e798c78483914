"""Time in the controller's hand, with live drivers on real ports: nothing is missed, and a pause changes nothing."""

import os
import signal
import time

import pytest
import serial
from pymodbus.client import ModbusSerialClient

import tactemu as tt
from tactemu.base.clock import VirtualClock
from tactemu.base.errors import TactemuError
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene import file
from tactemu.truth import Passage, entries
from tests.cli.command import start
from tests.fuzz import LONG

PAUSE_S = 10.0 if LONG else 1.0
FRAME = 82


def sent(log) -> list[tuple[int, bytes]]:
    return [(e.t_ns, bytes(e.frame)) for e in entries(log) if isinstance(e, Passage) and e.kind == "tx"]  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def of_virtual_time(tmp_path_factory):
    """What leaves in a second of virtual time."""
    emulator = assemble(file.load("anyskin"), AssemblyOptions(port="memory:", seed=7), clock=VirtualClock()).emulator
    with emulator:
        emulator.run(1.0)
        emulator.step()
    return [(t_ns, bytes(frame)) for t_ns, _, frame in emulator.truth.frames]  # type: ignore[arg-type]


def test_a_thousand_steps_by_a_client_give_the_bytes_of_virtual_time(tmp_path, of_virtual_time):
    """In a process of its own, which is stopped for a while as by a debugger; a driver reads all along."""
    log = tmp_path / "log.mcap"
    options = ("--clock", "lockstep", "--seed", "7", "--truth", str(log), "--name", "held")
    run = start("run", "anyskin", "--port", f"pty:{tmp_path / 'port'}", "--json", *options)
    assert run.stdout and run.stderr
    try:
        run.stdout.readline()
        with tt.connect("held") as held:
            with serial.Serial(held.state()["skins"]["anyskin"]["ports"][""], 115_200, timeout=5) as driver:
                time.sleep(0.2)  # until the open port has been noticed
                assert held.state()["t_s"] == 0.0, "time stands"
                read = b""
                for k in range(1000):
                    assert held.step() == pytest.approx((k + 1) * 1e-3)
                    if k == 500:
                        os.kill(run.pid, signal.SIGSTOP)
                        time.sleep(PAUSE_S)
                        os.kill(run.pid, signal.SIGCONT)
                    if k % 100 == 99:
                        read += driver.read(FRAME * 10 - (FRAME if k == 99 else 0))
        run.send_signal(signal.SIGTERM)
        assert run.wait(20) == 0, run.stderr.read()
    finally:
        run.kill()
    assert sent(log) == of_virtual_time
    assert read in b"".join(frame for _, frame in of_virtual_time)
    assert len(read) == 99 * FRAME


@pytest.mark.parametrize("port", ["tcp:0", "rfc2217:0", "pty:"])
def test_a_driver_reads_what_a_step_has_sent(of_virtual_time, port):
    with tt.serve("anyskin", port, clock="lockstep", seed=7) as dev:
        with serial.serial_for_url(dev.port, 115_200, timeout=5) as driver:
            dev.wait_for_driver()
            for k in range(5):
                dev.step(seconds=0.02)
                expected = [frame for t_ns, frame in of_virtual_time if k * 20e6 < t_ns <= (k + 1) * 20e6]
                assert driver.read(sum(map(len, expected))) == b"".join(expected)


def asked(pause_s: float) -> list:
    """What a polling driver reads between steps, with the skin pressed deeper and deeper."""
    with tt.serve("rohand", clock="lockstep", seed=5) as dev:
        client = ModbusSerialClient(dev.port, baudrate=115_200, timeout=5)
        assert client.connect()
        answers = []
        for k in range(12):
            dev.press(1e-4 * (k + 1), taxel=0, speed=1.0)
            dev.step(seconds=0.05)
            before = dev.state()["t_s"]
            time.sleep(pause_s * (k % 3))
            answers.append(client.read_holding_registers(2000, count=18, device_id=2).registers)
            assert dev.state()["t_s"] == before == pytest.approx(0.05 * (k + 1)), "it was answered while time stood"
        client.close()
    return answers


def test_a_driver_that_asks_is_answered_while_time_stands_and_always_the_same():
    first = asked(0.0)
    assert len({tuple(answer) for answer in first}) > 3, "it feels the press"
    assert asked(0.05) == first


def test_what_needs_time_waits_for_it():
    with tt.serve("anyskin", "memory:", clock="lockstep") as dev:
        dev.press(1e-3, dwell=0.1, taxel=2)  # does not wait for itself
        assert dev.step(10) == 0.01
        assert dev.step() == 0.011
        assert dev.step(until=0.5) == 0.5
        felt = [sample for sample in dev.truth.samples if sample.ideal.any()]
        assert felt and [s.t_ns % 10_000_000 for s in dev.truth.samples] == [0] * 51
        with pytest.raises(TactemuError, match=r"it is 0.5 s already"):
            dev.step(until=0.1)
        with pytest.raises(TactemuError, match="give one of n, seconds and until"):
            dev.step(1, until=0.6)
        dev.reset()
        dev.step(seconds=0.1)
        assert dev.truth.injected["reset"] == 1
    with tt.serve("anyskin", "memory:") as dev, pytest.raises(TactemuError, match="time runs by itself"):
        dev.step()
    with pytest.raises(TactemuError, match="clock: expected one of real, lockstep, paced, got 'virtual'"):
        tt.serve("anyskin", clock="virtual")
