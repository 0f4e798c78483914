"""docs/adding-a-device.md works as it stands: its pieces make devices that run and pass the check."""

import ast
import os
import subprocess
import sys
import tomllib

import pytest

import firmware_protocols as fp
from firmware_protocols.check import check
from firmware_protocols.check.host import SECOND_NS, Host
from tests.firmware.page import ROOT, pieces, write

TEMPLATE = ROOT / "firmware_protocols" / "template.py"


@pytest.fixture
def folder(tmp_path):
    return write(tmp_path)


def test_the_palm_has_no_fault_and_its_example_pins_all_that_it_declares(folder):
    report = check(f"{folder}/acme_palm.py:AcmePalm")
    assert report.ok, report.lines()
    assert report.examples == 1 and report.unpinned == ()


def test_the_grip_has_no_fault(folder):
    report = check(f"{folder}/acme_grip.py:AcmeGrip")
    assert report.ok and report.examples == 1, report.lines()


def test_the_template_has_no_fault():
    report = check(f"{TEMPLATE}:VendorModel")
    assert report.ok, report.lines()


def test_each_takes_less_than_120_lines_of_code():
    for name, text in pieces().items():
        if name.endswith(".py"):
            tree = ast.parse(text)
            docs = {
                id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant)
            }
            nodes = [
                n for n in ast.walk(tree) if hasattr(n, "lineno") and id(n) not in docs and not isinstance(n, ast.Expr)
            ]
            lines = {line for n in nodes for line in (n.lineno, n.end_lineno)}
            assert len(lines) < 120 and max(map(len, text.splitlines())) <= 120, name


def test_it_loads_from_its_path_and_with_its_option(folder):
    device = fp.create(f"{folder}/acme_palm.py:AcmePalm", serial="X")
    assert device.receive(bytes.fromhex("c17f00be"), 0, "") == [bytes.fromhex("c17f0158e7")]


def test_it_is_found_by_its_entry_point(folder):
    """As ``pip install`` would leave it; the command line prints the report and says so by its exit status."""
    points = tomllib.loads(pieces()["pyproject.toml"])["project"]["entry-points"]["tactemu.devices"]
    info = folder / "acme_palm-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme_palm\nVersion: 1.0\n")
    lines = [f"{name} = {target}" for name, target in points.items()]
    (info / "entry_points.txt").write_text("[tactemu.devices]\n" + "\n".join(lines) + "\n")
    command = [sys.executable, "-m", "tactemu", "check", "acme_palm"]
    environment = os.environ | {"PYTHONPATH": f"{folder}{os.pathsep}{ROOT}"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0 and done.stdout.startswith("acme_palm: no fault, 1 worked example"), done.stderr


# -- what only some hardware has: the grip ----------------------------------------------------------------------------


@pytest.fixture
def grip(folder):
    return Host(fp.create(f"{folder}/acme_grip.py:AcmeGrip"))


def test_two_streams_and_a_measurement_that_is_asked_for(grip):
    assert grip.device.periods == {"touch": 0, "chip": SECOND_NS // 20}
    assert grip.convert() == [b"T 250\n"]
    grip.pushes = 1.5
    before = grip.t_ns
    assert grip.send(b"M\n".hex()) == [b"F 1500 1500 1500 1500\n"]
    assert grip.t_ns - before == 2_000_000


def test_the_motor_goes_and_its_register_says_where(grip):
    assert grip.send("010600000000 89CA", "motor") == [bytes.fromhex("01060000000089CA")]
    grip.wait(SECOND_NS // 4)
    assert grip.device.joints(grip.t_ns) == {"opening": pytest.approx(0.05)}
    (answer,) = grip.send("010300010001 D5CA", "motor")
    assert answer[:5] == bytes.fromhex("01 03 02 01F4")
    grip.wait()
    grip.restart()
    assert grip.device.joints(grip.t_ns) == {"opening": pytest.approx(0.1)}


def test_a_unit_that_was_saved_is_in_force_from_the_next_power_up(grip):
    grip.send(b"U 7\n".hex())
    assert grip.device.unit == 1
    assert [type(out) for out in grip.device.lines(False, False, grip.t_ns, "finger")] == [fp.Restart]
    grip.restart()
    assert grip.device.unit == 7 and not grip.device.lines(False, False, grip.t_ns, "motor")
