"""``tactemu check``: a report, and its exit status."""

import json

import pytest

from tests.cli.command import ROOT, here, tactemu
from tests.firmware.page import write


@pytest.fixture
def palm(tmp_path):
    return write(tmp_path) / "acme_palm.py"


def test_a_fault_is_a_line_and_exits_with_1(palm):
    palm.write_text(palm.read_text().replace('data="B"', 'data="*"').replace("request.value", "request.data[0]"))
    done = tactemu("check", f"{palm}:AcmePalm", "serial=X", "--fuzz", "20")
    assert done.returncode == 1, done.stderr
    first, fault = done.stdout.split("\n", 1)
    assert first.startswith("acme_palm: 1 fault, 1 worked example")
    fault = " ".join(fault.split())
    assert "receive on c10200c3 raised IndexError" in fault and "acme_palm.py:" in fault


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        (
            "(Serial(baud=115200),)",
            "Serial(baud=115200)",
            "ports: expected a tuple of connectors, with a comma behind one",
        ),
        (
            "counts_per_unit=1000.0",
            "counts_per_unit=float('nan')",
            "column 'touch': scales, limits and rest must be finite",
        ),
        ('("force",)', '("forces",)', "senses: 'forces': expected one of force, pressure"),
        (
            "super().measure(reading, t_ns)",
            "super().measure(reading, t_ns) * float('nan')",
            "counts that are not finite",
        ),
    ],
)
def test_a_run_of_a_wrong_device_is_one_message(palm, right, wrong, said):
    text = palm.read_text()
    assert right in text
    palm.write_text(text.replace(right, wrong))
    done = here("run", f"{palm}:AcmePalm", "--port", "memory:", "--clock", "virtual", "--seconds", "0.1", "--plain")
    assert done.returncode == 2 and said in done.stderr and done.stderr.startswith("tactemu: "), done.stderr


def test_json(palm):
    done = tactemu("check", f"{palm}:AcmePalm", "--json", "--fuzz", "20")
    report = json.loads(done.stdout)
    assert done.returncode == 0 and report["ok"] and report["unpinned"] == [] and report["examples"] == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("anyskinn",), "did you mean 'anyskin'?"),
        ((str(ROOT / "none.py") + ":Palm",), "no such device file"),
        (("anyskin", "gain=1"), "unknown option 'gain'; did you mean 'gains'?"),
        (("anyskin", "gain"), "expected NAME=VALUE"),
    ],
)
def test_what_cannot_be_checked_exits_with_2(words, said):
    done = tactemu("check", *words)
    assert done.returncode == 2 and said in done.stderr, done.stderr
