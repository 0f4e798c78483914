"""``tactemu gadget``: its script, what FunctionFS is told, and a kernel's own host as the judge (in the guest)."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from firmware_protocols import USB, Bulk, Serial, create
from tactemu import transports
from tactemu.base.errors import DeviceError, TransportError
from tactemu.cli.app import app
from tactemu.cli.gadgets import script
from tactemu.transports import gadget
from tactemu.transports.usb.functionfs import function_descriptors, function_strings
from tactemu.transports.usb.raw_devices import BulkDevice, HidDevice
from tactemu.transports.usb.serial_chips import Ft232R
from tests.transports.usb_devices import RAW_HID

ROOT = Path(__file__).parents[2]
READINGS = 20
MODULES = "dummy_hcd libcomposite usb_f_fs usb_f_acm cdc-acm ftdi_sio cp210x ch341 usbhid hid-generic"


@pytest.mark.parametrize(
    ("device", "lines"),
    [
        ("anyskin", ["echo 0x239a >idVendor", "function=acm.tactemu", 'echo "$controller" >UDC', "serial:/dev/ttyGS"]),
        ("seed_fts3", ["echo 0x6010 >idProduct", "mount -t functionfs tactemu /dev/ffs-tactemu", "gadget:tactemu"]),
    ],
)
def test_a_dry_run_is_a_script(device, lines):
    done = CliRunner().invoke(app, ["gadget", device, "--udc", "fe980000.usb", "--seed", "3", "--dry-run"])
    assert done.exit_code == 0
    assert subprocess.run(["sh", "-n"], input=done.stdout, text=True, check=False).returncode == 0
    for each in (*lines, "controller=fe980000.usb", f"run {device} --seed 3 --port"):
        assert each in done.stdout


def test_what_is_made_is_removed_in_reverse(tmp_path):
    """In a folder in place of configfs: what is not undone there is what configfs makes by itself."""
    text = script(create("seed_fts3").ports[0], ["seed_fts3"], controller="udc0", name="test")
    for program in ("mount", "umount", "mountpoint", "modprobe"):
        (tmp_path / program).write_text("#!/bin/sh\n")
        (tmp_path / program).chmod(0o755)
    text = text.replace("/sys/kernel/config/usb_gadget", str(tmp_path)).replace("/dev/ffs-test", str(tmp_path / "ffs"))
    text = text.replace(f'{sys.executable} -m tactemu run seed_fts3 --port "$port"', "sleep 60")
    text = text.replace(
        'mkdir "$gadget"\n', 'mkdir "$gadget" && mkdir "$gadget/strings" "$gadget/configs" "$gadget/functions"\n'
    )
    text = text.replace('wait "$child"\n', 'find "$gadget"; kill -TERM $$; wait "$child"\n')
    path = {"PATH": f"{tmp_path}:/usr/sbin:/usr/bin:/sbin:/bin"}
    done = subprocess.run(["sh", "-c", text], capture_output=True, text=True, check=False, env=path, cwd=tmp_path)
    made = {line.partition("/test/")[2] for line in done.stdout.splitlines()}
    assert done.returncode == 143
    assert {"functions/ffs.test", "configs/c.1/ffs.test", "strings/0x409/product", "idVendor"} <= made
    left = {str(each.relative_to(tmp_path / "test")) for each in (tmp_path / "test").rglob("*") if each.is_dir()}
    assert left <= {"configs", "functions", "strings", "configs/c.1", "strings/0x409"}
    assert not (tmp_path / "ffs").exists()


def test_a_port_is_given_by_the_command():
    done = CliRunner().invoke(app, ["gadget", "anyskin", "--port", "pty:"])
    assert "leave out --port" in str(done.exception)
    done = CliRunner().invoke(app, ["gadget", "anyskn", "--dry-run"])
    assert isinstance(done.exception, DeviceError) and "did you mean 'anyskin'?" in str(done.exception)


def test_functionfs_is_told_interfaces_and_endpoints():
    """The layout of ``include/uapi/linux/usb/functionfs.h``: magic, length, flags, count, descriptors."""
    assert function_descriptors(Ft232R()) == bytes.fromhex(
        "03000000 27000000 41000000 03000000 09 04 00 00 02 ff ff ff 01 07 05 81 02 4000 00 07 05 02 02 4000 00"
    )
    assert function_strings(Ft232R()) == (
        bytes.fromhex("02000000 22000000 01000000 01000000 0904") + b"FT232R USB UART\0"
    )
    keys = HidDevice(RAW_HID)
    assert function_descriptors(keys)[12:16] == bytes.fromhex("04000000"), "with that of the class"
    assert function_strings(keys) == bytes.fromhex("02000000 10000000 00000000 00000000")
    assert len(function_descriptors(BulkDevice(Bulk(usb=USB(1, 2))))) == 16 + 9 + 7 + 7


def test_what_is_missing_is_said(tmp_path, monkeypatch):
    with pytest.raises(TransportError, match="expected gadget:NAME"):
        transports.create("gadget:")
    port = transports.create("gadget:none")
    with pytest.raises(TransportError, match="use serial:/dev/ttyGS0"):
        port.set_connector(Serial(baud=9600, usb=True))
    with pytest.raises(TransportError, match=r"there is no gadget none; sudo \$\(which tactemu\) gadget"):
        port.open()
    monkeypatch.setattr(gadget, "GADGETS", tmp_path)
    monkeypatch.setattr(gadget, "CONTROLLERS", tmp_path / "udc")
    (tmp_path / "none").mkdir()
    with pytest.raises(TransportError, match="no USB device controller"):
        port.open()


@pytest.mark.kernel
@pytest.mark.nightly
@pytest.mark.timeout(700)
def test_a_host_reads_every_device_at_the_end_of_its_cable():
    program = [sys.executable, "-m", "tests.transports.gadget_guest", str(READINGS)]
    guest = [ROOT / "scripts/kernel-guest", "-m", "1G", "-t", "600", "-M", MODULES, "--"]
    done = subprocess.run([*guest, *program], capture_output=True, text=True, check=False, cwd=ROOT)
    if done.returncode == 125:
        pytest.skip(done.stderr.strip().splitlines()[-1])
    said = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    assert [each.get("error") for each in said] == [None] * 6, done.stderr[-3000:]
    for each in said:
        assert (each["equal"], each["status"], each["left"]) == (READINGS, 143, []), each
