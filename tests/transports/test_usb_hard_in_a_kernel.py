"""What a USB device has to stand, in a guest: ``-m "nightly and kernel"``.

The kernel's own ``usbip`` program, drivers in C++ and in a namespace that has only their node, a cable that is pulled
200 times, and floods from the host's side.
"""

import json
import os
import shutil
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from tests.transports.played import Played

ROOT = Path(__file__).parents[2]
pytestmark = [pytest.mark.kernel, pytest.mark.nightly, pytest.mark.timeout(3000)]
UNPLUGS = int(os.environ.get("TACTEMU_UNPLUGS", "200"))
NODES = ("ttyACM0", "ttyUSB0")
CHIPS = ("cdc", "ftdi", "cp210x", "ch341")


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """What the guest says, by name, and the two devices."""
    folder = tmp_path_factory.mktemp("hard")
    fetched = subprocess.run(["apt-get", "download", "-qq", "usbip"], cwd=folder, capture_output=True, check=False)
    packages = list(folder.glob("usbip_*.deb"))
    if fetched.returncode or not packages or not shutil.which("g++"):
        pytest.skip("needs Debian's package usbip and g++")
    subprocess.run(["dpkg-deb", "-x", packages[0], folder / "root"], check=True)
    reader = folder / "serial_reader"
    subprocess.run(["g++", "-O1", "-o", reader, ROOT / "tests/transports/serial_reader.cpp"], check=True)
    with ExitStack() as stack:
        first = stack.enter_context(Played("anyskin", "usbip:cdc@0"))
        number = first.wire.transport.address.split("--tcp-port ")[1].split()[0]
        second = stack.enter_context(Played("anyskin", f"usbip:ftdi@{number}"))
        program = [sys.executable, "-m", "tests.transports.usb_hard_guest", number]
        guest = [ROOT / "scripts/kernel-guest", "-t", "2400", "-M", "vhci-hcd cdc-acm ftdi_sio cp210x ch341", "--"]
        done = subprocess.run(
            [*guest, *program, folder / "root/usr/sbin/usbip", reader, str(UNPLUGS)],
            capture_output=True, text=True, check=False, cwd=ROOT,
        )  # fmt: skip
        if done.returncode == 125:
            pytest.skip(done.stderr.strip().splitlines()[-1])
        assert done.returncode == 0, done.stderr[-3000:] + done.stdout[-3000:]
        lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
        yield {line.pop("name"): line for line in lines}, {"ttyACM0": first, "ttyUSB0": second}


def equal(readings, played):
    samples = played.samples()
    return sum(np.array(reading).tobytes() in samples for reading in readings)


def test_the_kernels_own_program_attaches_and_detaches(told):
    said, devices = told
    program = said["program"]
    assert equal(program["readings"], devices["ttyACM0"]) == len(program["readings"]) == 20
    assert "(239a:80cb)" in program["listed"] and "(0403:6001)" in program["listed"]
    assert "<Port in Use> at Full Speed(12Mbps)" in program["shown"] and program["is_gone"]


@pytest.mark.parametrize("node", NODES)
@pytest.mark.parametrize("way", ["C++", "namespace"])
def test_every_reading_is_a_sample(told, way, node):
    said, devices = told
    readings = said[f"{way} {node}"]["readings"]
    assert equal(readings, devices[node]) == len(readings) == 20


def test_a_cable_may_be_pulled_many_times(told):
    said, devices = told
    unplugs = said["unplugs"]
    assert equal(unplugs["readings"], devices["ttyACM0"]) == len(unplugs["readings"]) == UNPLUGS
    assert unplugs["errors"] == unplugs["nodes"] == UNPLUGS


@pytest.mark.parametrize("chip", CHIPS)
def test_a_flood_from_the_host_waits_and_nothing_is_lost(told, chip):
    said, _ = told
    assert said[f"flood {chip}"]["is_equal"]
