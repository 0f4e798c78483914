"""``usbip:``, judged by a USB/IP client that is not ours; ``test_usb_in_a_kernel.py`` has the kernel's."""

import contextlib
import select
import socket
import struct
import time

import pytest
import usbip
from usbip import host

from firmware_protocols import USB, Can, Serial
from tactemu import transports
from tactemu.base.errors import TactemuError, TransportError
from tactemu.transports.transport import Closed, LinesChanged, Noted, Opened, Received, SerialSetting, SettingChanged
from tactemu.transports.usb import usbip_protocol as protocol
from tactemu.transports.usb import vhci
from tests.transports.usbip_ends import Polled, asks

BOARD = Serial(
    baud=115_200, usb=USB(vid=0x239A, pid=0x80CB, manufacturer="Adafruit", product="QT Py M0", serial="AB12")
)
BRIDGE = Serial(baud=115_200, usb=USB(vid=0x0403, pid=0x6001, node="ttyUSB"))
UART = Serial(baud=115_200)
SECOND = Serial(baud=1_000_000, usb=USB(0x0403, 0x6010, interface=1, node="ttyUSB"))
FIRST = Serial(baud=1_000_000, usb=USB(0x0403, 0x6010, node="ttyUSB"))


# Fields of real devices (lsusb -v): a QT Py is CDC-ACM; FT232RL: ksksue.hatenadiary.org 2012-02-12; FT2232C:
# /proc/bus/usb/devices in community.sparkfun.com topic 5031 (a board's EEPROM sets the current, there 300 mA; the
# number of the interfaces' string is that of a clone, enjoy-digital/litex#1793); CP2102: mvp/uhubctl#526; CH340:
# memtest86plus#387.
DEVICE_DESCRIPTORS = {
    "ftdi": "12 01 0002 00 00 00 08 0304 0160 0006 01 02 00 01",
    "ft2232": "12 01 0002 00 00 00 08 0304 1060 0005 01 02 00 01",
    "cp210x": "12 01 1001 00 00 00 40 c410 60ea 0001 01 02 03 01",
    "ch341": "12 01 1001 ff 00 00 08 861a 2375 6202 00 02 00 01",
}
CONFIGURATIONS = {
    "ftdi": "09 02 2000 01 01 00 a0 2d 09 04 00 00 02 ff ff ff 02 07 05 81 02 4000 00 07 05 02 02 4000 00",
    "ft2232": "09 02 3700 02 01 00 80 32 09 04 00 00 02 ff ff ff 02 07 05 81 02 4000 00 07 05 02 02 4000 00"
    " 09 04 01 00 02 ff ff ff 02 07 05 83 02 4000 00 07 05 04 02 4000 00",
    "cp210x": "09 02 2000 01 01 00 80 32 09 04 00 00 02 ff 00 00 02 07 05 81 02 4000 00 07 05 01 02 4000 00",
    "ch341": "09 02 2700 01 01 00 80 31 09 04 00 00 03 ff 01 02 00 07 05 82 02 2000 00 07 05 02 02 2000 00"
    " 07 05 81 03 0800 01",
}


@pytest.mark.parametrize("chip", DEVICE_DESCRIPTORS)
def test_descriptors_are_those_of_the_real_chip(chip):
    with Polled(f"{chip}@0", UART) as polled, polled.client() as handle:
        assert handle.control(0x80, 6, 0x0100, 0, 18) == bytes.fromhex(DEVICE_DESCRIPTORS[chip])
        assert handle.control(0x80, 6, 0x0200, 0, 255) == bytes.fromhex(CONFIGURATIONS[chip])
        assert handle.control(0x80, 6, 0x0200, 0, 9) == bytes.fromhex(CONFIGURATIONS[chip])[:9]


def test_descriptors_are_those_of_a_candlelight_adapter():
    """The fields of lsusb -v in candle-usb/candleLight_fw#175; those of its DFU interface in src/usbd_gs_can.c."""
    with Polled("0", Can(), "gsusb") as polled, polled.client() as handle:
        assert handle.control(0x80, 6, 0x0100, 0, 18) == bytes.fromhex(
            "12 01 0002 00 00 00 40 501d 6f60 0000 01 02 03 01"
        )
        assert handle.control(0x80, 6, 0x0200, 0, 255) == bytes.fromhex(
            "09 02 3200 02 01 00 80 4b 09 04 00 00 02 ff ff ff 00 07 05 81 02 2000 00 07 05 02 02 2000 00"
            " 09 04 01 00 00 fe 01 01 e0 09 21 0b ff00 0008 1a01"
        )
        assert b"upgrade" in handle.control(0x80, 6, 0x03E0, 0x409, 255).replace(b"\0", b"")
        assert handle.control(0xA1, 3, 0, 1, 6) == bytes(5) + b"\xff"


def test_a_board_has_its_makers_ids_and_strings():
    with Polled("0", BOARD) as polled:
        (info,) = host.list_devices(usbip.USBIP("127.0.0.1", polled.number))
        assert (info["idVendor"], info["idProduct"]) == (0x239A, 0x80CB)
        assert [(each.vid, each.pid) for each in vhci.listed("127.0.0.1", polled.number)] == [(0x239A, 0x80CB)]
        with polled.client() as handle:
            texts = [handle.control(0x80, 6, 0x0300 + k, 0x409, 255)[2:].decode("utf-16-le") for k in (1, 2, 3)]
            assert texts == ["Adafruit", "QT Py M0", "AB12"]


def test_bytes_pass_both_ways_and_a_driver_is_there_while_it_asks():
    with Polled("0", BOARD) as polled, polled.client() as handle:
        assert not polled.write(b"nobody has the port open")
        got = []
        thread = asks(handle, 0x81, 64, got)
        polled.wait(Opened)
        assert polled.write(bytes(range(40)))
        thread.join()
        assert got == [bytes(range(40))]
        handle.bulk_out(0x02, b"request")
        assert polled.wait(Received) == Received(b"request")
        handle.close()
        polled.wait(Closed)
        assert not polled.write(b"gone")


def test_line_coding_and_modem_lines_of_a_board():
    with Polled("0", BOARD) as polled, polled.client() as handle:
        handle.control(0x21, 0x20, 0, 0, struct.pack("<IBBB", 460_800, 2, 2, 7))
        assert polled.wait(SettingChanged).setting == SerialSetting(460_800, 7, "E", 2)
        assert polled.port.setting == SerialSetting(460_800, 7, "E", 2)
        handle.control(0x21, 0x22, 3, 0, b"")
        assert polled.wait(LinesChanged) == LinesChanged(True, True)
        assert handle.control(0xA1, 0x21, 0, 0, 7) == struct.pack("<IBBB", 460_800, 2, 2, 7)


@pytest.mark.parametrize(("divisor", "baud"), [(0x001A, 115_385), (0x4006, 461_538), (0, 3_000_000), (1, 2_000_000)])
def test_an_ftdi_makes_of_a_divisor_what_the_chip_makes(divisor, baud):
    """Divisors as ftdi_sio sends them for 115200, 460800, 3 M and 2 M bit/s."""
    with Polled("0", BRIDGE) as polled, polled.client() as handle:
        handle.control(0x40, 3, divisor, 0, b"")
        assert polled.wait(SettingChanged).setting.baud == baud


def test_an_ftdi_sends_its_status_before_each_62_bytes():
    with Polled("0", BRIDGE) as polled, polled.client() as handle:
        got = []
        thread = asks(handle, 0x81, 512, got)
        polled.wait(Opened)
        assert polled.write(bytes(100))
        thread.join()
        assert got == [b"\x31\x60" + bytes(62) + b"\x31\x60" + bytes(38)]
        handle.control(0x40, 9, 1, 0, b"")
        polled.wait(Noted, what="latency timer 1 ms")
        assert handle.control(0xC0, 10, 0, 0, 1) == b"\x01"


def test_several_devices_on_one_address_are_ports_of_one_hub():
    with Polled("0", BOARD) as first, Polled(str(first.number), BRIDGE) as second:
        devices = host.list_devices(usbip.USBIP("127.0.0.1", first.number))
        assert [(each["busid"], each["idVendor"]) for each in devices] == [("1-1", 0x239A), ("1-2", 0x0403)]
        with second.client() as handle:
            handle.bulk_out(0x02, b"to the second")
            assert second.wait(Received).data == b"to the second" and not first.events


def test_two_devices_are_the_two_channels_of_one_chip():
    with Polled("0", SECOND) as second, Polled(str(second.number), FIRST) as first:
        assert [each.busid for each in vhci.listed("127.0.0.1", first.number)] == ["1-1"]
        with second.client() as handle:
            got = []
            thread = asks(handle, 0x83, 64, got)
            second.wait(Opened)
            assert second.write(b"of B") and not first.write(b"nobody reads A")
            thread.join()
            assert got == [b"\x31\x60of B"]
            handle.bulk_out(0x02, b"to A")
            handle.bulk_out(0x04, b"to B")
            assert first.wait(Received).data == b"to A" and second.wait(Received).data == b"to B"
            # Speeds and latency timers as ftdi_sio sets them: bit 16 of the divisor beside the number of the channel.
            handle.control(0x40, 3, 0x001A, 0x0001, b"")
            handle.control(0x40, 3, 0xC01A, 0x0102, b"")
            assert first.wait(SettingChanged).setting.baud == 115_385
            assert second.wait(SettingChanged).setting.baud == round(3_000_000 / 26.875)
            handle.control(0x40, 9, 1, 2, b"")
            assert [handle.control(0xC0, 10, 0, channel, 1) for channel in (1, 2)] == [b"\x10", b"\x01"]
        for port in (first, second):
            port.wait(Noted, what="detached by the host")


def test_a_chip_is_unplugged_with_either_channel_and_back_with_both():
    with Polled("0", FIRST) as first, Polled(str(first.number), SECOND) as second:
        handle = first.client()
        second.wait(Noted, what="attached by a host")
        with first._lock:
            first.port.close()
        second.wait(Noted, what="detached by the host")
        with pytest.raises(usbip.USBError):
            second.client()
        with first._lock:
            first.port.open()
        handle.close()
        with second.client() as handle:
            handle.bulk_out(0x02, b"to A again")
            assert first.wait(Received).data == b"to A again"


def test_a_loop_may_wait_for_a_connection_that_the_other_channel_has_closed():
    first = transports.create("usbip:0")
    first.set_connector(FIRST)
    with first:
        number = int(first.address.split()[2])
        second = transports.create(f"usbip:{number}")
        second.set_connector(SECOND)
        with second, socket.create_connection(("127.0.0.1", number)) as client:
            client.sendall(protocol.OP.pack(protocol.VERSION, protocol.OP_REQ_IMPORT, 0) + b"1-1".ljust(32, b"\0"))
            seen = {first: [], second: []}
            deadline = time.monotonic() + 5
            while not all(seen.values()) and time.monotonic() < deadline:
                for port, events in seen.items():
                    events += port.poll()
            assert set(map(tuple, seen.values())) == {(Noted("attached by a host"),)}
            waited = second.filenos()
            client.close()
            while len(seen[first]) < 2 and time.monotonic() < deadline:
                seen[first] += first.poll()
            select.select(waited, [], [], 0)  # fails if the connection has been closed under it
            assert second.poll() == [Noted("detached by the host")]
            assert len(waited) == 3 and len(second.filenos()) == 2


def test_a_third_device_is_on_a_chip_of_its_own():
    with Polled("ft2232@0", UART) as first, Polled(f"ft2232@{first.number}", UART) as second:
        with Polled(f"ft2232@{first.number}", UART) as third:
            busids = [each.port.address.split()[-1] for each in (first, second, third)]
            assert busids == ["1-1", "1-1", "1-2"]


def test_a_device_is_given_to_one_host_and_again_when_it_has_gone():
    with Polled("0", BOARD) as polled:
        with polled.client(), pytest.raises(usbip.USBError):
            polled.client()
        polled.wait(Noted)
        deadline = time.monotonic() + 5
        while time.monotonic() < deadline:
            try:
                polled.client().close()
                break
            except usbip.USBError:
                time.sleep(0.01)
        else:
            raise AssertionError("it is never free again")


def test_a_host_that_sends_faster_than_the_device_takes_waits():
    port = transports.create("usbip:0")
    port.set_connector(BOARD)
    with port:
        number = int(port.address.split("--tcp-port ")[1].split()[0])
        client = socket.create_connection(("127.0.0.1", number))
        client.sendall(protocol.OP.pack(protocol.VERSION, protocol.OP_REQ_IMPORT, 0) + b"1-1".ljust(32, b"\0"))
        head = struct.Struct(">5IIiIiI8s")
        for k in range(20):
            client.sendall(head.pack(1, k, 0, 0, 2, 0, 64, 0, 0, 0, bytes(8)) + bytes(64))
        events = []
        deadline = time.monotonic() + 0.3
        while time.monotonic() < deadline:
            events += port.poll(reading=False)
        assert not any(isinstance(event, Received) for event in events)
        deadline = time.monotonic() + 5
        while sum(len(event.data) for event in events if isinstance(event, Received)) < 20 * 64:
            assert time.monotonic() < deadline
            events += port.poll()
        client.close()


@pytest.mark.parametrize(
    "junk",
    [b"GET / HTTP/1.1\r\n\r\n" * 4, bytes(100), b"\x01\x11\x80\x03" + b"\xff" * 60],
    ids=["http", "zeros", "no such device"],
)
def test_a_client_that_does_not_speak_usbip_is_closed(junk):
    with Polled("0", BOARD) as polled:
        client = socket.create_connection(("127.0.0.1", polled.number), timeout=5)
        client.sendall(junk)
        with contextlib.suppress(ConnectionResetError):
            while client.recv(1000):
                pass
        with polled.client():
            pass


def test_requests_that_are_no_usbip_end_the_connection():
    with Polled("0", BOARD) as polled:
        handle = polled.client()
        handle.conn.sock.sendall(b"\xff" * 48)
        assert handle.conn.sock.recv(100) == b""
        polled.wait(Noted, what="detached by the host")


@pytest.mark.parametrize(
    ("endpoint", "direction", "length"), [(1, 1, 64), (2, 0, 0), (0, 1, 18)], ids=["asks", "sends", "takes no answers"]
)
def test_a_host_that_floods_is_cut_off(endpoint, direction, length):
    """More requests than any driver has, or answers that it never takes: both are bounded."""
    with Polled("0", BOARD) as polled:
        client = socket.create_connection(("127.0.0.1", polled.number), timeout=20)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.sendall(protocol.OP.pack(protocol.VERSION, protocol.OP_REQ_IMPORT, 0) + b"1-1".ljust(32, b"\0"))
        setup = struct.pack("<BBHHH", 0x80, 6, 0x0100, 0, 18)
        head = struct.Struct(">5IIiIiI8s")
        requests = b"".join(
            head.pack(1, number, 0, direction, endpoint, 0, length, 0, 0, 0, setup) for number in range(1500)
        )
        if endpoint == 2:
            polled.port.poll = lambda reading=True, poll=polled.port.poll: poll(reading=False)
        with pytest.raises(OSError):
            for _ in range(400):
                client.sendall(requests)
        polled.wait(Noted, what="detached by the host")


@pytest.mark.parametrize(
    ("address", "message"), [("ftdj@0", "did you mean 'ftdi'"), ("cdc@x", "expected usbip:PORT"), ("x", "expected")]
)
def test_wrong_addresses_say_what_is_expected(address, message):
    with pytest.raises(TransportError, match=message):
        transports.create(f"usbip:{address}")


def test_a_device_on_can_is_refused():
    with pytest.raises(TransportError, match="no serial port"):
        transports.create("usbip:0").set_connector(Can())


def test_attaching_names_what_is_missing(monkeypatch, tmp_path):
    with pytest.raises(TactemuError, match=r"no USB/IP at 127\.0\.0\.1:9: Connection refused"):
        vhci.listed("127.0.0.1", 9)
    monkeypatch.setattr(vhci, "VHCI", tmp_path / "none")
    with pytest.raises(TactemuError, match="sudo modprobe vhci-hcd"):
        vhci.attach("127.0.0.1", 9, "1-1")
