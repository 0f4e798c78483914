"""``tactemu check-host --port``: what the hardware behind a port is, holds and needs. The loop is a pty's."""

import json
import os
import threading
import tty

import pytest

from tactemu.base.errors import TactemuError
from tactemu.cli import check_port
from tactemu.transports.adapter import net_adapter, tty_adapter
from tactemu.transports.can_link import CanLink
from tests.cli.command import tactemu


@pytest.fixture
def plug():
    """The path of a port that receives what it sends, and a list of the bytes that get lost."""
    far, near = os.openpty()
    tty.setraw(near)
    lost = []

    def echo():
        try:
            while data := os.read(far, 4096):
                os.write(far, data.replace(lost[0], b"") if lost else data)
        except OSError:
            pass

    thread = threading.Thread(target=echo, daemon=True)
    thread.start()
    yield f"serial:{os.ttyname(near)}", lost
    os.close(near)
    thread.join(5)
    os.close(far)


def found_of(address, **options):
    return {each.name: each for each in check_port.check_port(address, **options)}


def test_a_port_with_a_plug_is_measured(plug, monkeypatch):
    monkeypatch.setattr(check_port, "STREAM_S", 0.2)
    found = found_of(plug[0], loopback=True)
    assert list(found) == ["adapter", "latency", "errors", "speeds", "echo", "stream", "jitter"]
    assert "no hardware" in found["adapter"].says and "all equal" in found["stream"].says
    assert found["stream"].there and "100 times a second" in found["jitter"].says


def test_lost_bytes_and_a_missing_plug_are_found(plug, monkeypatch):
    monkeypatch.setattr(check_port, "STREAM_S", 0.1)
    monkeypatch.setattr(check_port, "WAIT_S", 0.2)
    plug[1].append(b"\x07")
    found = found_of(plug[0], loopback=True)
    assert not found["echo"].there and "byte 8 of 200" in found["echo"].says and not found["stream"].there
    plug[1][0] = b"\x55"
    assert "join TX to RX" in found_of(plug[0], loopback=True)["loop"].helps


def test_the_command_says_what_it_found_and_wrong_use(plug):
    done = tactemu("check-host", "--port", plug[0], "--json")
    assert list(json.loads(done.stdout)) == ["adapter", "latency", "errors", "speeds"] and done.returncode == 1
    assert tactemu("check-host", "--loopback").returncode == 2
    assert "cannot open /dev/ttyUSB77" in tactemu("check-host", "--port", "serial:ttyUSB77").stderr
    assert "expected serial:NAME or can:" in tactemu("check-host", "--port", "tcp:5000").stderr


def test_an_adapter_is_named_by_its_driver_ids_and_serial_number(tmp_path):
    port = tmp_path / "devices/usb1/1-1/1-1:1.0/ttyUSB0"
    for folder in (port / "tty", tmp_path / "class/tty/ttyUSB0", tmp_path / "bus/drivers/ftdi_sio"):
        folder.mkdir(parents=True)
    (port / "driver").symlink_to(tmp_path / "bus/drivers/ftdi_sio")
    (tmp_path / "class/tty/ttyUSB0/device").symlink_to(port)
    for name, text in {
        "idVendor": "0403\n", "idProduct": "6001\n", "manufacturer": "FTDI\n", "product": "FT232R USB UART\n",
        "serial": "A600eHYG\n",
    }.items():  # fmt: skip
        (tmp_path / "devices/usb1/1-1" / name).write_text(text)
    told = str(tty_adapter("ttyUSB0", tmp_path))
    assert told == "ftdi_sio, 0403:6001 FTDI FT232R USB UART, serial number A600eHYG"
    assert str(net_adapter("can0", tmp_path)) == ""


def test_a_uart_of_a_board_is_named_by_the_driver_above_those_in_between(tmp_path):
    port = tmp_path / "devices/pnp0/00:04/00:04:0/00:04:0.0"
    for folder in (port, tmp_path / "class/tty/ttyS0", tmp_path / "drivers/port", tmp_path / "drivers/serial"):
        folder.mkdir(parents=True)
    (port / "driver").symlink_to(tmp_path / "drivers/port")
    (tmp_path / "devices/pnp0/00:04/driver").symlink_to(tmp_path / "drivers/serial")
    (tmp_path / "class/tty/ttyS0/device").symlink_to(port)
    (tmp_path / "class/tty/ttyS0/type").write_text("4\n")
    assert str(tty_adapter("ttyS0", tmp_path)) == "serial, 16550A"


def can_findings(monkeypatch, link, down=False):
    monkeypatch.setattr("tactemu.transports.can_link.can_link", lambda name: link)
    monkeypatch.setattr(check_port, "is_down", lambda name: down)
    return found_of("can:socketcan:can0")


def test_a_can_adapter_tells_its_bus_and_what_to_change(monkeypatch):
    counts = {"bus_error": 3, "arbitration_lost": 5}
    good = CanLink("can", 1_000_000, 0.75, state="ERROR-ACTIVE", queue_length=1000, counts=counts)
    found = can_findings(monkeypatch, good)
    assert found["bus"].says == "1000000 bit/s, no CAN-FD, sample point 75.0%, ERROR-ACTIVE" and found["queue"].there
    assert not found["errors"].there and "bus_error 3, arbitration_lost 5" in found["errors"].says
    found = can_findings(monkeypatch, CanLink("can", queue_length=10), down=True)
    assert "sudo ip link set can0 up type can bitrate" in found["bus"].helps
    assert "txqueuelen 1000" in found["queue"].helps and "errors" not in found
    assert not can_findings(monkeypatch, CanLink("vcan", queue_length=1000))["adapter"].there
    with pytest.raises(TactemuError, match=r"no CAN interface 'can0' \(CAN interfaces: none\)"):
        can_findings(monkeypatch, None)
    links = {"vcan0": CanLink("vcan"), "lo": CanLink("loopback")}
    monkeypatch.setattr("tactemu.transports.can_link.can_link", links.get)
    monkeypatch.setattr("socket.if_nameindex", lambda: list(enumerate(links)))
    with pytest.raises(TactemuError, match=r"'vcan'; did you mean 'vcan0'\? \(CAN interfaces: vcan0\)"):
        found_of("can:socketcan:vcan")
    with pytest.raises(TactemuError, match="for serial ports"):
        found_of("can:socketcan:can0", loopback=True)
