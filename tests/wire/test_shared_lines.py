"""Devices with several ports, links, streams and motors, and lines with several devices, through the whole emulator."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.clock import VirtualClock
from tactemu.base.errors import DeviceError, SceneError
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene.file import parse

DEVICES = Path(__file__).parents[1] / "devices"
PAD = '[[body]]\nname = "pad"\nshape = "frame"\nfixed = true\n'

SERVOS = """
import sys
import scservo_sdk as sdk
port, handler = sdk.PortHandler(sys.argv[1]), sdk.PacketHandler(0)
assert port.openPort() and port.setBaudRate(1_000_000)
def answers(ask, *args):  # a busy machine is late for the SDK's time-out: again; it may read past its data
    for _ in range(30):
        try:
            yield ask(port, *args)
        except IndexError:
            continue
def asked(ask, *args):
    return next((answer for answer in answers(ask, *args) if 0 in answer[-2:-1]), None)
for ident in range(1, 7):
    assert asked(handler.ping, ident) == (777, 0, 0), ident
for ident in range(1, 7):
    assert asked(handler.write2ByteTxRx, ident, 42, 1000 + 100 * ident) == (0, 0), ident
import time; time.sleep(0.4)
reader = sdk.GroupSyncRead(port, handler, 56, 2)
for ident in range(1, 7):
    assert reader.addParam(ident)
good = 0
for _ in range(100):
    if reader.txRxPacket() != 0:
        continue
    good += 1
    if good > 20:
        break
    print(*[reader.getData(ident, 56, 2) for ident in range(1, 7)])
"""

UNITS = """
import sys
from pymodbus.client import ModbusSerialClient
from pymodbus.exceptions import ModbusIOException
client = ModbusSerialClient(sys.argv[1], baudrate=19200, timeout=1)
assert client.connect()
for _ in range(10):
    print(*[value for unit in (1, 2) for value in client.read_holding_registers(0, count=2, device_id=unit).registers])
try:
    client.read_holding_registers(0, count=2, device_id=3)
except ModbusIOException:
    print("nobody")
"""


def driver(code: str, port: str) -> list[str]:
    done = subprocess.run([sys.executable, "-c", code, port], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.fixture
def scene(tmp_path):
    def write(text: str) -> Path:
        path = tmp_path / "scene.toml"
        path.write_text(PAD + text)
        return path

    return write


@pytest.mark.driver
def test_six_servos_in_two_devices_on_one_line_answer_a_sync_read_in_turn(scene, tmp_path):
    skins = "".join(
        f'[[skin]]\nname = "{name}"\ndevice = "{DEVICES}/servo_bus.py:ServoBus"\nlink = "pad"\n'
        f'port = "pty:{tmp_path}/bus"\ndevice_options = {{ first = {first} }}\n'
        for name, first in (("lower", 1), ("upper", 4))
    )
    with tt.serve(scene(skins)) as dev:
        rows = driver(SERVOS, dev.port)
        assert rows == ["1100 1200 1300 1400 1500 1600"] * 20
        wire = dev.emulator.wires[0]
        assert len(dev.emulator.wires) == 1 and wire.counters["collision"] == 0


@pytest.mark.driver
def test_two_modbus_units_on_one_line(scene, tmp_path):
    skins = "".join(
        f'[[skin]]\nname = "unit {unit}"\ndevice = "{DEVICES}/modbus_unit.py:ModbusUnit"\nlink = "pad"\n'
        f'position = [{0.1 * unit}, 0.0, 0.0]\nport = "pty:{tmp_path}/line"\ndevice_options = {{ unit = {unit} }}\n'
        for unit in (1, 2)
    )
    ball = '[[body]]\nname = "ball"\nshape = "sphere"\nradius = 0.01\nposition = [0.2, 0.0, 0.012]\n'
    with tt.serve(scene(ball + skins)) as dev:
        dev.press(depth=1e-3, skin="unit 2", body="ball")
        push = dev.sample("unit 2").counts[0]
        assert push > 0
        assert driver(UNITS, dev.port) == [f"0 1 {push} 2"] * 10 + ["nobody"]


def gripper(more: str = "") -> str:
    return f'[[skin]]\ndevice = "{DEVICES}/gripper.py:Gripper"\nname = "gripper"\nlink = "pad"\n{more}'


def fingers() -> str:
    return "".join(
        f'[[body]]\nname = "{side}"\nshape = "frame"\nposition = [{x}, 0.0, 0.0]\n'
        f'[body.motion]\nkind = "joint"\nskin = "gripper"\njoint = "{side}"\naxis = [1, 0, 0]\nslide = true\n'
        for side, x in (("left", 0.0), ("right", 0.0))
    )


def ran(text: str, seconds: float, *todo) -> object:
    emulator = assemble(parse(PAD + text), AssemblyOptions(port={"touch": "memory:t", "motors": "memory:m"})).emulator
    emulator.clock = VirtualClock()
    for at_s, what in todo:
        emulator.at(round(at_s * 1e9), lambda what=what: what(emulator))
    emulator.open()
    emulator.run(seconds)
    return emulator


def test_two_ports_and_two_streams_each_at_its_rate():
    emulator = ran(gripper(), 1.1)
    (channel,) = emulator.channels
    touch, motors = channel.wires["touch"], channel.wires["motors"]
    frames = [frame for _, _, frame in emulator.truth.frames]
    assert frames[0] == b"ready\n" and not motors.counters["sent"]
    assert sum(frame[0] == 0xA5 for frame in frames) == pytest.approx(100, abs=1)
    assert sum(frame[0] == 0x5A for frame in frames) == pytest.approx(50, abs=1)
    assert touch.counters["sent"] == len(frames)
    assert channel.rates_hz() == {"touch": 100.0, "sound": 50.0}


def test_one_rate_for_two_different_streams_is_asked_back():
    with pytest.raises(DeviceError, match=r"which stream\? give a table, as \{ touch = 200, sound = 200 \}"):
        assemble(parse(PAD + gripper("rate_hz = 200\n")))
    emulator = ran(gripper("rate_hz = { touch = 200 }\n"), 1.1)
    assert emulator.channels[0].rates_hz() == {"touch": 200.0, "sound": 50.0}


def test_what_is_written_to_one_port_is_answered_there():
    emulator = ran(
        gripper(),
        0.5,
        (0.2, lambda e: e.channels[0].wires["motors"].transport.driver.write(b"\x00")),
        (0.4, lambda e: e.channels[0].wires["motors"].transport.driver.write(b"\x00")),
    )
    heard = emulator.channels[0].wires["motors"].transport.driver.read()
    assert heard[0] == b"\xff\xff" and heard[1] <= b"\x06\x06"


def test_an_answer_with_the_next_conversion_comes_when_it_is_ready():
    emulator = ran(gripper(), 0.2055, (0.201, lambda e: e.channels[0].wires["touch"].transport.driver.write(b"?")))
    times = [t_ns for t_ns, _, frame in emulator.truth.frames if frame[0] == 0xA5]
    assert times[-1] == 204_000_000


def test_dtr_restarts_the_board_which_says_so_again():
    def toggle(emulator, level):
        emulator.channels[0].wires["touch"].transport.driver.set_lines(dtr=level, rts=level)

    emulator = ran(gripper(), 2.0, (1.5, lambda e: toggle(e, False)), (1.6, lambda e: toggle(e, True)))
    banners = [t_ns for t_ns, _, frame in emulator.truth.frames if frame == b"ready\n"]
    assert banners == [100_000_000, 1_700_000_000]
    quiet = [t for t, _, f in emulator.truth.frames if 1_600_000_000 < t < 1_700_000_000]
    assert quiet == []


def test_fingers_on_links_of_their_own_close_on_a_ball():
    """The left finger follows its joint from -40 mm towards 0; there its pad meets a ball that the right one misses."""
    links = 'links = { left = { body = "left", quaternion = [0.7071068, 0.0, 0.7071068, 0.0] }, right = "right" }\n'
    ball = '[[body]]\nname = "ball"\nshape = "sphere"\nradius = 0.01\nposition = [-0.02, 0.0, 0.0]\nfixed = true\n'
    text = ball + fingers() + gripper(links)
    emulator = ran(text, 1.0, (0.3, lambda e: e.channels[0].wires["motors"].transport.driver.write(b"\xb8")))
    samples = [s for s in emulator.truth.samples if s.sense == "force"]
    before = [s for s in samples if s.t_ns < 300_000_000]
    assert not any(s.measured.any() for s in before)
    last = samples[-1]
    assert last.counts[:4].sum() > 0 and not last.counts[4:].any()
    assert (last.measured[:4, 2] <= 0).all(), "pushed into the pad, in the finger's own frame"


def test_imperfections_of_a_skin_on_two_links_change_while_it_runs():
    event = "[[scenario]]\nat = 0.2\nset = { bias = 0.5 }\n"
    emulator = ran(fingers() + gripper('links = { left = "left", right = "right" }\n') + event, 0.4)
    samples = [s for s in emulator.truth.samples if s.sense == "force"]
    before = [s.measured for s in samples if s.t_ns < 200_000_000]
    assert not np.any(before) and (samples[-1].measured == 0.5).all()


def test_a_burst_brings_its_values_oldest_first():
    press = (
        '[[body]]\nname = "ball"\nshape = "sphere"\nradius = 0.01\nposition = [-0.03, 0.0, 0.011]\n'
        '[body.motion]\nkind = "press"\napproach = 0.002\ndepth = 0.002\nspeed = 0.02\n'
    )
    emulator = ran(press + gripper(), 0.5)
    bursts = [s.measured for s in emulator.truth.samples if s.sense == "vibration" and s.measured.any()]
    assert bursts[0].shape == (1, 8)
    rising = bursts[1][0]  # the first is the look at boot, eight times the same
    assert (np.diff(rising) >= 0).all() and rising[-1] > rising[0]


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ('links = { thumb = "pad" }\n', "no link 'thumb'.*links: left, right"),
        ('links = { left = "hand" }\n', "links.left: no body 'hand'"),
        ('ports = { can = "memory:" }\n', "has no port 'can'"),
    ],
)
def test_what_is_not_there_is_named(more, says):
    with pytest.raises((SceneError, DeviceError), match=says):
        assemble(parse(PAD + gripper(more)))


def test_a_joint_that_is_not_there_is_named():
    with pytest.raises(SceneError, match=r"no joint 'middle' \(joints: left, right\)"):
        assemble(parse(PAD + fingers().replace('joint = "left"', 'joint = "middle"') + gripper()))
