"""A HID and a device of a vendor's class on ``usbip:``, judged by a USB/IP client that is not ours."""

import pytest
import usbip

from firmware_protocols import USB, Bulk, Hid
from tactemu import transports
from tactemu.base.errors import TransportError
from tactemu.transports.transport import Closed, Noted, Opened, Received
from tactemu.transports.usbip import MAX_TO_HOST_BYTES
from tests.transports.usb_devices import RAW_HID, REPORTS, TEENSY
from tests.transports.usbip_ends import Polled, asks

BULK = Bulk(usb=USB(0x59E3, 0x74C7, product="TakkTile"), endpoint_in=0x81, endpoint_out=0x02)


def test_a_hid_has_the_descriptors_of_its_class():
    with Polled("0", RAW_HID) as polled, polled.client() as handle:
        assert handle.control(0x80, 6, 0x0200, 0, 255) == bytes.fromhex(
            "09 02 2900 01 01 00 80 32 09 04 00 00 02 03 00 00 00 09 21 1101 00 01 22 1c00"
            " 07 05 81 03 4000 01 07 05 02 03 4000 01"
        )
        assert handle.control(0x81, 6, 0x2200, 0, 255) == REPORTS
        assert handle.control(0x81, 6, 0x2100, 0, 255) == bytes.fromhex("09 21 1101 00 01 22 1c00")


def test_a_report_is_a_transfer_and_none_is_joined_with_another():
    with Polled("0", RAW_HID) as polled, polled.client() as handle:
        got = []
        thread = asks(handle, 0x81, 64, got)
        polled.wait(Opened)
        assert polled.write(bytes(range(64))) and polled.write(bytes(64)) and polled.write(b"short")
        thread.join()
        assert [got[0], handle.interrupt_in(0x81, 64), handle.interrupt_in(0x81, 64)] == [
            bytes(range(64)), bytes(64), b"short"
        ]  # fmt: skip
        assert handle.control(0xA1, 1, 0x0100, 0, 64) == b"short", "GET_REPORT: the newest"
        handle.interrupt_out(0x02, b"\x01" * 64)
        assert polled.wait(Received).data == b"\x01" * 64
        handle.control(0x21, 9, 0x0200, 0, b"\x02" * 64)
        polled.wait(Received, data=b"\x02" * 64)
        handle.close()
        polled.wait(Closed)


def test_a_hid_without_an_endpoint_from_the_host_gets_reports_by_control_requests():
    with Polled("0", Hid(usb=TEENSY, report_descriptor=REPORTS, output_bytes=0)) as polled, polled.client() as handle:
        assert handle.control(0x80, 6, 0x0200, 0, 255)[13] == 1
        handle.control(0x21, 9, 0x0200, 0, b"\x03" * 8)
        assert polled.wait(Received).data == b"\x03" * 8


def test_what_a_hid_does_not_have_is_refused():
    with Polled("0", RAW_HID) as polled, polled.client() as handle:
        for request in ((0xA1, 1, 0x0300, 0, 64), (0x21, 9, 0x0300, 0, b"feature"), (0x40, 1, 0, 0, b"")):
            with pytest.raises(usbip.Stall):
                handle.control(*request)
        assert handle.control(0x21, 0x0A, 0, 0, b"") == 0, "SET_IDLE"


def test_a_transfer_of_a_vendors_class_is_a_frame_of_any_length():
    with Polled("0", BULK) as polled, polled.client() as handle:
        polled.wait(Opened)
        assert polled.write(bytes(range(200))) and polled.write(b"next")
        assert handle.bulk_in(0x81, 128) == bytes(range(128))
        assert handle.bulk_in(0x81, 128) == bytes(range(128, 200))
        assert handle.bulk_in(0x81, 128) == b"next"
        handle.bulk_out(0x02, bytes(1000))
        assert polled.wait(Received).data == bytes(1000)


def test_a_vendors_device_that_nobody_reads_keeps_a_bounded_number_of_whole_frames():
    with Polled("0", BULK) as polled, polled.client() as handle:
        polled.wait(Opened)
        taken = sum(polled.write(bytes([number]) * 100) for number in range(100))
        assert taken == MAX_TO_HOST_BYTES // 100
        assert [handle.bulk_in(0x81, 512)[0] for _ in range(taken)] == list(range(taken))
        assert polled.write(b"again")


def test_an_unplugged_hid_forgets_what_waited():
    with Polled("0", RAW_HID) as polled:
        with polled.client() as handle:
            got = []
            thread = asks(handle, 0x81, 64, got)
            polled.wait(Opened)
            assert polled.write(b"1") and polled.write(b"stale")
            thread.join()
        polled.wait(Noted, what="detached by the host")
        with polled.client() as handle:
            thread = asks(handle, 0x81, 64, got)
            while not polled.write(b"2"):
                pass
            thread.join()
        assert got == [b"1", b"2"]


def test_a_chip_has_no_place_in_such_a_device():
    with pytest.raises(TransportError, match="leave out the chip"):
        transports.create("usbip:ftdi@0").set_connector(RAW_HID)
