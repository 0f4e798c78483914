"""``usbip:`` attached to Debian's own kernel, whose drivers and unmodified sensor drivers read it: ``-m kernel``."""

import json
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from tests.transports.played import Played
from tests.transports.test_usbip import CONFIGURATIONS, DEVICE_DESCRIPTORS

ROOT = Path(__file__).parents[2]
pytestmark = [pytest.mark.kernel, pytest.mark.timeout(1000)]
NODES = {"ttyACM0": "cdc", "ttyUSB0": "ftdi", "ttyUSB1": "cp210x", "ttyUSB2": "ch341"}
NODES |= {"ttyUSB3": "ft2232", "ttyUSB4": "ft2232"}  # two devices, one chip
READINGS = 60


@pytest.fixture(scope="module")
def told():
    """What the guest's programs say, and the devices that they read."""
    with ExitStack() as stack:
        first = stack.enter_context(Played("anyskin", "usbip:cdc@0"))
        number = first.wire.transport.address.split("--tcp-port ")[1].split()[0]
        others = [stack.enter_context(Played("anyskin", f"usbip:{chip}@{number}")) for chip in list(NODES.values())[1:]]
        own = [
            stack.enter_context(Played(f"tests/transports/usb_devices.py:{name}", f"usbip:{number}"))
            for name in ("ForceKeys", "BulkPad")
        ]
        # A translated guest loses some of 1,600 frames a second in its adapter's queue: at 20 samples a second, none.
        board = stack.enter_context(Played("xela_uskin", f"gsusb:{number}", hz=20))
        modules = "vhci-hcd cdc-acm ftdi_sio cp210x ch341 usbhid hid-generic gs_usb can-raw"
        program = [sys.executable, str(ROOT / "tests/transports/usb_guest.py"), number, str(READINGS), *NODES]
        done = subprocess.run(
            [ROOT / "scripts/kernel-guest", "-m", "1G", "-t", "900", "-M", modules, "--", *program],
            capture_output=True, text=True, check=False, cwd=ROOT,
        )  # fmt: skip
        if done.returncode == 125:
            pytest.skip(done.stderr.strip().splitlines()[-1])
        assert done.returncode == 0, done.stderr[-3000:] + done.stdout[-3000:]
        lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
        yield (
            {line.pop("node"): line for line in lines if "node" in line},
            dict(zip([*NODES, "hid", "bulk", "can0"], [first, *others, *own, board])),
        )


@pytest.mark.parametrize("node", NODES)
def test_every_reading_of_anyskins_driver_is_a_sample(told, node):
    said, played = told
    samples = played[node].samples()
    readings = [np.array(reading).tobytes() for reading in said[node]["readings"]]
    assert sum(reading in samples for reading in readings) == len(readings) == READINGS


@pytest.mark.parametrize("node", list(NODES)[1:])  # the first is attached anew, with the speed of a new node
def test_the_chip_has_the_speed_that_the_driver_set(told, node):
    _, played = told
    made = {"cp210x": 115_200}.get(NODES[node], 115_385)
    assert played[node].wire.transport.setting.baud == made


def test_the_kernel_lists_the_ids_of_maker_and_chips(told):
    said, _ = told
    ids = {node: (said[node]["vid"], said[node]["pid"]) for node in NODES}
    assert ids == {
        "ttyACM0": ("239a", "80cb"), "ttyUSB0": ("0403", "6001"),
        "ttyUSB1": ("10c4", "ea60"), "ttyUSB2": ("1a86", "7523"),
        "ttyUSB3": ("0403", "6010"), "ttyUSB4": ("0403", "6010"),
    }  # fmt: skip


@pytest.mark.parametrize("way", ["hid", "hidraw", "hidraw0", "bulk"])
def test_every_report_and_transfer_is_a_sample(told, way):
    said, played = told
    samples = played[way if way == "bulk" else "hid"].samples()
    readings = [np.array(reading, float).tobytes() for reading in said[way]["readings"]]
    assert sum(reading in samples for reading in readings) == len(readings) == READINGS // 3


def test_pyserial_pyudev_libusb_and_hidapi_find_the_devices(told):
    said, _ = told
    found = said["listed"]
    hand = [0x16C0, 0x0486, "Teensyduino", "Teensyduino RawHID", "12345", 0]
    assert found["hidapi"] == [hand] and found["hidraw"] == [[0x16C0, 0xFFAB, 0x0200]]
    ports = {port[5]: tuple(port[:5]) for port in found["pyserial"]}
    assert ports == {
        "ttyACM0": ("239a", "80cb", "Adafruit", "QT Py M0", None),
        "ttyUSB0": ("0403", "6001", "FTDI", "FT232R USB UART", None),
        "ttyUSB1": ("10c4", "ea60", "Silicon Labs", "CP2102 USB to UART Bridge Controller", "0001"),
        "ttyUSB2": ("1a86", "7523", None, "USB2.0-Serial", None),
        "ttyUSB3": ("0403", "6010", "FTDI", "Dual RS232", None),
        "ttyUSB4": ("0403", "6010", "FTDI", "Dual RS232", None),
    }
    ids = {(port[0], port[1]) for port in found["pyserial"]} | {("16c0", "0486"), ("1209", "0002"), ("1d50", "606f")}
    assert {tuple(each) for each in found["pyudev"]} - {("1d6b", "0002"), ("1d6b", "0003")} == ids
    assert {tuple(each[:2]) for each in found["pyusb"]} >= ids
    names = {tuple(each[2:]) for each in found["pyusb"]}
    assert names >= {("bytewerk", "candleLight USB to CAN adapter"), ("Nobody", "Bulk pad"), ("FTDI", "Dual RS232")}


@pytest.mark.parametrize("chip", DEVICE_DESCRIPTORS)
def test_the_kernel_has_the_chips_descriptors_bit_by_bit(told, chip):
    said, _ = told
    assert bytes.fromhex(DEVICE_DESCRIPTORS[chip] + CONFIGURATIONS[chip]).hex() in said["listed"]["descriptors"]


def test_a_board_on_can_is_read_through_an_adapter(told):
    said, played = told
    samples = {np.ravel(sample.counts).astype(int).tobytes() for sample in played["can0"].truth.samples}
    readings = [np.ravel(reading).astype(int).tobytes() for reading in said["can0"]["readings"]]
    assert sum(reading in samples for reading in readings) == len(readings) == 40


def test_at_another_bit_rate_nobody_acknowledges(told):
    said, _ = told
    assert said["can0"]["states"] == ["ERROR-PASSIVE", "ERROR-ACTIVE"]
    assert said["can0"]["counted"] == [["error_passive", "unacknowledged"], []]


def test_a_bus_at_another_bit_rate_is_refused_with_the_command_that_mends_it(told):
    said, _ = told
    unset, other, agreeing = said["can0"]["refusals"]
    assert "can0 has no bit rate; sudo ip link set can0 up type can bitrate 1000000" in unset
    assert "can0 runs at 500000 bit/s, the device at 1000000; sudo ip link set can0 down && sudo" in other
    assert not agreeing


def test_a_device_that_is_unplugged_is_attached_again(told):
    said, _ = told
    assert said["unplugged"] == {"error": True, "is_back": True}
