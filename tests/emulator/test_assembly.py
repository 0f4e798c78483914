"""From scene files to emulators: buses are shared, ports are not, and what a skin says reaches its channel."""

import tempfile
from ipaddress import ip_address

import can
import numpy as np
import pytest

import firmware_protocols
from tactemu.base.clock import VirtualClock
from tactemu.base.errors import DeviceError, SceneError, TransportError
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.emulator.port_assignment import assign_ports
from tactemu.scene.building import make_device, make_devices
from tactemu.scene.file import load, parse
from tactemu.truth import Truth, read
from tactemu.wire.line_models.can import CanLine
from tests.scenes import ball, pad

BODIES = pad() + ball(0.02, [0, 0, 0.0195])


def skin(device: str, more: str = "") -> str:
    return f'[[skin]]\ndevice = "{device}"\nlink = "pad"\n{more}\n'


def test_two_boards_share_one_bus():
    port = 'port = "can:virtual:two-boards"'
    boards = [skin("xela_uskin", f'name = "board {n}"\ndevice_options = {{ board = {n} }}\n{port}') for n in (1, 2)]
    emulator = assemble(parse(BODIES + "".join(boards))).emulator
    emulator.clock = VirtualClock()
    assert len(emulator.wires) == 1
    with emulator, can.Bus(interface="virtual", channel="two-boards") as bus:
        for channel in emulator.channels:
            start = next(c for c in channel.device.commands if "start" in c.name)
            bus.send(
                can.Message(
                    arbitration_id=start.frame.arbitration_id,
                    data=start.frame.data,
                    is_extended_id=start.frame.is_extended_id,
                )
            )
        emulator.run(0.5)
        seen = set()
        while (message := bus.recv(0)) is not None:
            seen.add(message.arbitration_id)
    sent = {
        name: {f.arbitration_id for _, n, f in emulator.truth.frames if n == name} for name in ("board 1", "board 2")
    }
    assert sent["board 1"] and sent["board 2"] and not sent["board 1"] & sent["board 2"]
    assert seen == sent["board 1"] | sent["board 2"]


def test_what_arrives_is_logged_under_who_is_on_the_wire(tmp_path):
    """Also before the device has sent anything; on a bus, under all of them."""
    port = 'port = "can:virtual:owners"'
    boards = [
        skin("xela_uskin", f'name = "{n}"\ndevice_options = {{ board = {k} }}\n{port}') for k, n in ((1, "a"), (2, "b"))
    ]
    polled = skin("paxini_px6ax", 'name = "polled"\nport = "memory:"')
    emulator = assemble(parse(BODIES + "".join(boards) + polled), truth=Truth(tmp_path / "t.jsonl")).emulator
    emulator.clock = VirtualClock()
    with emulator, can.Bus(interface="virtual", channel="owners") as bus:
        bus.send(can.Message(arbitration_id=0x201, data=b"\x07\x00", is_extended_id=False))
        emulator.wires[1].transport.driver.write(emulator.channels[2].device.commands[0].frame)
        emulator.run(0.1)
    rows = [row for row in read(tmp_path / "t.jsonl") if row["kind"] in ("rx", "tx")]
    assert {(row["kind"], row["device"]) for row in rows} == {
        ("rx", "a+b"),
        ("tx", "a"),
        ("rx", "polled"),
        ("tx", "polled"),
    }


def test_devices_of_other_speeds_do_not_share_a_bus(tmp_path):
    slow = tmp_path / "slow.py"
    slow.write_text(
        "from firmware_protocols import Can\n"
        "from firmware_protocols.devices.xela_uskin import XelaUskin\n"
        "class Slow(XelaUskin):\n"
        "    def __init__(self):\n"
        "        super().__init__()\n"
        "        self.ports = (Can(bitrate=500_000),)\n"
    )
    port = 'port = "can:virtual:x"'
    with pytest.raises(TransportError, match="put them on two buses"):
        assemble(parse(BODIES + skin("xela_uskin", port) + skin(f"{slow}:Slow", port)))


def test_a_serial_port_is_not_shared():
    with pytest.raises(SceneError, match="cannot share pty:/tmp/one; USB serial 115200 8N1 has one device"):
        assemble(
            parse(BODIES + skin("anyskin", 'name = "a"') + skin("anyskin", 'name = "b"')),
            AssemblyOptions(port="pty:/tmp/one"),
        )


def test_what_a_skin_says_reaches_its_channel():
    more = (
        'name = "tip"\nrate_hz = 250\nport = "memory:"\npacing = false\nfaults = ["drop 1%"]\n'
        "clock = { delay_s = 0.003, jitter_s = 0.001, skew_ppm = 50 }\n"
        "position = [0.0, 0.0, 0.001]\nquaternion = [0.0, 0.0, 0.0, 1.0]\n"
        "options = { radius = 0.002, normal_stiffness = 100.0 }"
    )
    made = assemble(parse(BODIES + skin("anyskin", more)))
    channel = made.emulator.channels[0]
    assert (channel.name, channel.period_ns(""), channel.wire.pacing) == ("tip", 4_000_000, False)
    sampling = channel.sampling
    assert (sampling.delay_ns, sampling.jitter_ns, sampling.skew_ppm) == (3_000_000, 1_000_000, 50)
    assert [str(fault) for fault in channel.wire.faults] == ["drop 1%"]
    model = made.scene.sensors[0].model
    np.testing.assert_allclose(model.positions[1], (0.007, 0, 0.001 - 0.002), atol=1e-12, err_msg="turned, sunk")
    assert model.normal_stiffness == 100.0


def test_the_device_reads_in_its_own_frame():
    """Half a turn about z: the ball over the link's +x is over the chip at the device's -x."""
    bodies = BODIES.replace("[0, 0, 0.0195]", "[0.007, 0, 0.0195]")
    made = assemble(parse(bodies + skin("anyskin", 'port = "memory:"\nquaternion = [0.0, 0.0, 0.0, 1.0]')))
    made.emulator.clock = VirtualClock()
    with made.emulator:
        made.emulator.run(0.1)
    sample = made.emulator.truth.samples[-1]
    assert np.argmin(sample.measured[:, 2]) == 1, "chip 1 is to the left"


def test_usual_and_fresh_ports():
    def port(name: str, *, fresh: bool) -> str:
        loaded = load(name)
        (plug,) = assign_ports(loaded.tables.skin, make_devices(loaded), None, fresh=fresh)
        return plug.address

    assert port("anyskin", fresh=False) == f"pty:{tempfile.gettempdir()}/tactemu-anyskin"
    assert port("linker_hand_l6", fresh=False).startswith("can:")
    for name in ("anyskin", "linker_hand_l6"):
        assert port(name, fresh=True) != port(name, fresh=True)


def test_whatever_the_process_a_fresh_bus_is_a_group_of_multicast(monkeypatch):
    (connector,) = firmware_protocols.create("linker_hand_l6").ports
    line_model, pids = CanLine(connector), iter(range(0, 2**22, 31))
    monkeypatch.setattr(line_model, "fresh_number", lambda: (next(pids), 0))
    groups = {line_model.fresh_port("hand").removeprefix("can:udp_multicast:") for _ in range(2 * 254**2)}
    assert len(groups) == 254**2
    assert all(ip_address(group).is_multicast for group in groups), "and each is an address"


def test_a_connector_is_found_that_goes_with_the_port():
    loaded = load("inspire_rh56dftp")
    devices = make_devices(loaded)

    def plugged(port):
        return {plug.connector.name: plug.address for plug in assign_ports(loaded.tables.skin, devices, port)}

    assert plugged("pty:/tmp/x") == {"rtu": "pty:/tmp/x"}
    assert plugged("tcp:127.0.0.1:0") == {"tcp": "tcp:127.0.0.1:0"}, "rather than the serial line over a socket"
    assert plugged({"tcp": "tcp:127.0.0.1:0", "rtu": "memory:"}) == {"tcp": "tcp:127.0.0.1:0", "rtu": "memory:"}
    assert plugged({"touch/rtu": "memory:a"}) == {"rtu": "memory:a"}
    with pytest.raises(DeviceError, match=r"has a serial or tcp connector.* into can:; ports that fit: pty:, rfc"):
        plugged("can:virtual:x")
    with pytest.raises(DeviceError, match="no port 'usb'"):
        plugged({"usb": "memory:"})


@pytest.mark.parametrize(
    ("name", "options", "says"),
    [
        ("linker_hand_l6", {"sde": "left"}, "unknown option 'sde'; did you mean 'side'"),
        ("linker_hand_l6", {"side": "up"}, "device linker_hand_l6"),
        ("xela_uskin", {"board": 99}, "option board: must be a whole number >= 1 and <= 15, got 99"),
    ],
)
def test_device_options_are_checked(name, options, says):
    with pytest.raises(DeviceError, match=says):
        make_device(name, options)
