"""CAN ports: they stay on this machine, filter identifiers, and outlive their network interface."""

import errno
import json
import os
import socket
import struct
import time
from pathlib import Path

import can
import pytest

from firmware_protocols import Can, CanFrame
from tactemu.base.errors import TransportError, TransportUnavailable
from tactemu.transports import create, socketcan
from tactemu.transports.can_errors import BusErrors, errors_of
from tactemu.transports.can_link import CanLink, advice, can_link, mismatch
from tactemu.transports.transport import CanFilter, Closed, Counted, Opened, Received

GROUP = "239.74.77.9"


def hops(port):
    """Return the hop limits of a port's datagrams, as the kernel has them."""
    with socket.socket(fileno=port.filenos()[0]) as copy:
        there = struct.unpack("@i", copy.getsockopt(socket.IPPROTO_IP, socket.IP_TTL, 4))[0]
        multicast = copy.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL)
        copy.detach()
    return {there, multicast}


def test_multicast_stays_on_the_machine_unless_told(monkeypatch, caplog):
    with create(f"can:udp_multicast:{GROUP}") as port:
        assert 0 in hops(port) and not caplog.records
        with can.Bus(interface="udp_multicast", channel=GROUP, hop_limit=0) as driver:
            driver.send(can.Message(arbitration_id=0x28, data=[1], is_extended_id=False))
            assert heard(port) == [0x28]
    config = json.loads(os.environ["CAN_CONFIG"])
    monkeypatch.setenv("CAN_CONFIG", json.dumps(config | {"hop_limit": 1}))
    with create(f"can:udp_multicast:{GROUP}") as port:
        assert 0 not in hops(port)
        assert [record.getMessage().count("network") for record in caplog.records] == [1]


def heard(port, seconds=2.0):
    """Return the identifiers that arrive with the first frames, within ``seconds``."""
    events, end = [], time.monotonic() + seconds
    while not events and time.monotonic() < end:
        events = port.poll()
        time.sleep(0.002)
    return [event.data.arbitration_id for event in events if isinstance(event, Received)]


def test_filtered_identifiers_are_not_received():
    port = create("can:virtual:filters")
    port.set_filters([CanFilter(0x28), CanFilter(0x400, 0x700), CanFilter(0x28, extended=True)])
    with port, can.Bus(interface="virtual", channel="filters") as driver:
        for ident, extended in [
            (0x28, False),
            (0x29, False),
            (0x4AB, False),
            (0x5AB, False),
            (0x28, True),
            (0x4AB, True),
        ]:
            driver.send(can.Message(arbitration_id=ident, is_extended_id=extended))
        assert heard(port) == [0x28, 0x4AB, 0x28]


class Interface:
    """Linux CAN as a program sees it when the adapter is pulled and plugged in again."""

    def __init__(self):
        self.index, self.filters, self.ends = 7, [], []

    def can_socket(self, name, filters):
        if not self.index:
            raise OSError("No such device")
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.setblocking(False)
        self.filters.append(filters)
        self.ends.append(theirs)
        return ours


@pytest.fixture
def interface(monkeypatch):
    made = Interface()
    monkeypatch.setattr(socketcan, "can_socket", made.can_socket)
    monkeypatch.setattr(socketcan, "_index_of", lambda name: made.index)
    monkeypatch.setattr(socketcan, "is_down", lambda name: False)
    yield made
    for end in made.ends:
        end.close()


def failing(port, monkeypatch, number):
    """Fail as the kernel does for the next reader of the port."""

    class Failing:
        def recv(self, size):
            monkeypatch.setattr(port, "_in", before)
            raise OSError(number, os.strerror(number))

    before = port._in
    monkeypatch.setattr(port, "_in", Failing())


def test_an_interface_that_goes_and_comes_back_is_opened_again(interface, caplog, monkeypatch):
    frame = CanFrame(arbitration_id=0x28, data=b"\x01")
    port = create("can:socketcan:can9")
    port.set_filters([CanFilter(0x28)])
    with port:
        assert port.write(frame) and port.poll() == []
        interface.index = 0
        failing(port, monkeypatch, errno.ENODEV)
        assert port.poll() == [Closed()] and port.poll() == []
        assert not port.has_reader and not port.filenos() and not port.write(frame)
        interface.index = 8
        assert port.poll() == [Opened()] and port.poll() == []
        assert port.has_reader and port.filenos() and port.write(frame)
        interface.index = 9  # gone and made again between two looks
        failing(port, monkeypatch, errno.ENODEV)
        assert port.poll() == [Closed()] and port.poll() == [Opened()]
    assert interface.filters == [(CanFilter(0x28),)] * 3
    assert [record.getMessage() for record in caplog.records] == [
        "can:socketcan:can9: the interface is gone; waiting for it to come back",
        "can:socketcan:can9: the interface is back",
    ] * 2


@pytest.mark.parametrize(
    ("mtu", "data_bitrate", "works"), [(72, 5_000_000, True), (16, None, True), (16, 5_000_000, False)]
)
def test_a_device_with_fd_frames_needs_an_interface_that_carries_them(interface, monkeypatch, mtu, data_bitrate, works):
    monkeypatch.setattr(socketcan, "mtu_of", lambda name: mtu, raising=False)
    port = create("can:socketcan:can9")
    port.set_connector(Can(bitrate=1_000_000, data_bitrate=data_bitrate))
    if works:
        with port:
            assert port.has_reader
        return
    with pytest.raises(TransportError, match=r"can9 carries no CAN-FD \(MTU 16\).*sudo ip link set can9 .* mtu 72 up"):
        port.open()
    monkeypatch.setattr("tactemu.transports.can_link.can_link", lambda name: CanLink("can", 1_000_000))
    with pytest.raises(TransportError, match="ip link set can9 up type can bitrate 1000000 dbitrate 5000000 fd on"):
        port.open()
    assert not port.has_reader


def test_the_mtu_of_an_interface_is_the_kernels():
    assert socketcan.mtu_of("lo") == int(Path("/sys/class/net/lo/mtu").read_text())


def test_an_interface_that_is_only_down_keeps_its_socket(interface, monkeypatch):
    with create("can:socketcan:can9") as port:
        failing(port, monkeypatch, errno.ENETDOWN)
        assert port.poll() == [] and port.has_reader


def test_a_name_that_no_interface_can_have_is_no_reason_to_make_one():
    with pytest.raises(TransportUnavailable, match="no interface whose name is longer than 15 bytes; shorten it"):
        create("can:socketcan:a_name_of_sixteen").open()


def test_a_node_receives_its_own_group_only():
    with create("can:udp_multicast:239.74.77.1") as one, create("can:udp_multicast:239.74.77.2") as other:
        with can.Bus(interface="udp_multicast", channel="239.74.77.1") as driver:
            driver.send(can.Message(arbitration_id=0x28, data=[0xC2], is_extended_id=False))
        end = time.monotonic() + 5
        while not (received := one.poll()) and time.monotonic() < end:
            time.sleep(0.01)
        assert received == [Received(CanFrame(arbitration_id=0x28, data=b"\xc2"))]
        assert other.poll() == []


# -- a real bus --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("link", "device", "says"),
    [
        (CanLink("can"), Can(), "has no bit rate; sudo ip link set can0 up type can bitrate 1000000"),
        (CanLink("can", 500_000), Can(), "runs at 500000 bit/s, the device at 1000000"),
        (CanLink("can", 1_000_000), Can(data_bitrate=5_000_000), "carries no CAN-FD"),
        (CanLink("can", 1_000_000, 0.8, 2_000_000, True), Can(data_bitrate=5_000_000), "sends data at 2000000 bit/s"),
        (CanLink("can", 1_000_000, state="BUS-OFF"), Can(), "is bus-off"),
        (CanLink("can", 1_000_000, state="ERROR-ACTIVE"), Can(), None),
    ],
)
def test_a_real_bus_is_compared_with_the_device(link, device, says):
    why = mismatch(link, "can0", device)
    assert why is None if says is None else says in why


def test_a_real_bus_gets_advice():
    passive, short = advice(CanLink("can", 1_000_000, state="ERROR-PASSIVE", queue_length=10), "can0")
    assert "120 Ohm" in passive and "txqueuelen 1000" in short
    assert not advice(CanLink("can", 1_000_000, 0.875, state="ERROR-ACTIVE", queue_length=1000), "can0")
    (early,) = advice(CanLink("can", 1_000_000, 0.5, state="ERROR-ACTIVE", queue_length=1000), "can0")
    assert "samples at 50% of a bit, most nodes at 70% to 90%" in early and "bitrate 1000000 sample-point 0.8" in early


@pytest.mark.parametrize(
    ("identifier", "details", "counted"),
    [
        (0x02, "0b", {"arbitration_lost"}),
        (0x04, "0010", {"error_passive"}),
        (0x04, "0008", {"error_warning"}),
        (0x04, "0001", {"controller_overflow"}),
        (0x04, "0040", set()),
        (0x88, "00000219", {"unacknowledged"}),
        (0xA8, "", {"unacknowledged"}),
        (0x88, "0000100f", {"bus_error"}),
        (0x40, "", {"bus_off"}),
        (0x100, "", {"restarts"}),
        (0x24, "0020", {"unacknowledged", "error_passive"}),
        (0x200, "000000000000807f", set()),
    ],
)
def test_error_frames_of_a_controller_are_counted_by_what_they_say(identifier, details, counted):
    assert errors_of(identifier, bytes.fromhex(details)) == counted


def test_a_state_of_the_bus_is_said_once_until_it_restarts(caplog):
    errors = BusErrors("can3")
    for _ in range(3):
        errors.add(0x04, b"\0\x20")
        errors.add(0x40, b"")
    assert [record.message[:22] for record in caplog.records] == ["can3 is error-passive:", "can3 is bus-off, and t"]
    assert "sudo ip link set can3 type can restart-ms 100" in caplog.records[1].message
    assert errors.take() == [Counted("bus_off", 3), Counted("error_passive", 3)] and errors.take() == []
    errors.add(0x100, b"")
    errors.add(0x40, b"")
    assert len(caplog.records) == 3


@pytest.mark.parametrize(("device", "fd"), [(Can(bitrate=250_000), {}), (Can(data_bitrate=5_000_000), {"fd": True})])
def test_an_adapter_is_set_to_the_bit_rates_of_the_device_and_paces_its_bus(monkeypatch, device, fd):
    class Adapter:
        messages = [can.Message(is_error_frame=True), can.Message(arbitration_id=0x28, is_extended_id=False), None]
        options = None

        def __init__(self, **options):
            Adapter.options = options

        def recv(self, timeout):
            return self.messages.pop(0)

        def fileno(self):
            raise NotImplementedError

        def shutdown(self):
            pass

    monkeypatch.setattr(can, "Bus", Adapter)
    port = create("can:pcan:PCAN_USBBUS1")
    port.set_connector(device)
    with port:
        rates = {"bitrate": device.bitrate} | ({"data_bitrate": 5_000_000} if fd else {})
        assert Adapter.options == {"interface": "pcan", "channel": "PCAN_USBBUS1", **fd, **rates}
        assert port.is_paced and not create("can:virtual:v").is_paced
        events = []
        while len(events) < 2:  # a thread reads the adapter
            events += port.poll()
        assert Counted("bus_error", 1) in events
        assert [event.data.arbitration_id for event in events if isinstance(event, Received)] == [0x28]


def test_the_kernel_tells_the_kind_of_an_interface():
    assert can_link("lo").kind == "" and can_link("no-such-name") is None
