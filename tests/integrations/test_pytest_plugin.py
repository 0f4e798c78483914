"""The pytest plugin, in a pytest of its own."""

import re
import subprocess
import sys
from xml.etree import ElementTree

from tactemu.truth import read_log
from tests.cli.command import environment, plugin_options

TEST = """
import os
import sys

ports = []

def test_with(tactile_device):
    with tactile_device("anyskin", rate_hz=100, seed=7) as dev:
        ports.append(dev.port)
        dev.press(depth=1e-3)
        assert any(s.ideal.any() for s in dev.truth.samples)
    assert not os.path.lexists(ports[0])

def test_without_with(tactile_device):
    first, second = tactile_device("anyskin"), tactile_device("anyskin")
    assert first.port != second.port
    ports[:] = [first.port, second.port]
    assert all(map(os.path.exists, ports))

def test_stopped_afterwards():
    assert not any(map(os.path.lexists, ports))
"""


def run_pytest(folder, *arguments):
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", *plugin_options(), "-p", "no:cacheprovider", *arguments],
        cwd=folder, env=environment(), capture_output=True, text=True, timeout=100, check=False,
    )  # fmt: skip


def test_the_fixture_serves_devices(tmp_path):
    (tmp_path / "test_it.py").write_text(TEST)
    done = run_pytest(tmp_path)
    assert "3 passed" in done.stdout, done.stdout + done.stderr


def test_nothing_is_imported_until_it_is_used(tmp_path):
    (tmp_path / "test_it.py").write_text(
        "import sys\ndef test_light():\n    assert not {'warp', 'trimesh', 'can', 'pydantic'} & set(sys.modules)\n"
    )
    done = run_pytest(tmp_path)
    assert "1 passed" in done.stdout, done.stdout + done.stderr


FAILING = """
def test_bad(tactile_device):
    with tactile_device("anyskin") as dev:
        dev.press(depth=1e-3)
        assert dev.simulation.context.seed == 0

def test_good(tactile_device):
    assert tactile_device("anyskin").simulation.context.seed == 23
    assert tactile_device("anyskin", seed=4).simulation.context.seed == 4

def test_bad_in_the_background(tactile_device):
    device = tactile_device("anyskin")
    device.emulator.call(lambda: 1 / 0)
    device._thread.join(5)
"""


def test_the_truth_of_tests_that_fail_is_kept_and_named_and_the_seed_is_the_one_given(tmp_path):
    (tmp_path / "test_it.py").write_text(FAILING)
    (tmp_path / "pytest.ini").write_text("[pytest]\ntactemu_truth_dir = kept\n")
    done = run_pytest(tmp_path, "--tactemu-seed", "23", "-n", "2")
    assert "2 passed" in done.stdout and "1 failed" in done.stdout and "1 error" in done.stdout, done.stdout
    kept = sorted((tmp_path / "kept").iterdir())
    assert [path.name for path in kept] == [
        "test-it.py-test-bad-1.mcap",
        "test-it.py-test-bad-1.svg",
        "test-it.py-test-bad-in-the-background-1.mcap",
        "test-it.py-test-bad-in-the-background-1.svg",
    ]
    for path in kept:
        assert str(path) in done.stdout
    assert f"tactemu: truth and pictures of 2 tests that failed: {tmp_path / 'kept'}" in done.stdout
    assert "anyskin" in read_log(kept[0])
    assert "@font-face" not in kept[1].read_text(), "it asks no host for anything"
    picture = " ".join(ElementTree.parse(kept[1]).getroot().itertext())
    assert re.search(r"anyskin.*peak.[\d.]+.N", picture.replace("\xa0", " "), re.DOTALL), "what was felt"


def test_a_seed_that_is_none_is_refused_before_any_test_runs(tmp_path):
    done = run_pytest(tmp_path, "--tactemu-seed", "x")
    assert done.returncode == 4 and "--tactemu-seed: expected a whole number, got 'x'" in done.stderr


def test_a_folder_that_cannot_be_written_is_refused_before_any_test_runs(tmp_path):
    (tmp_path / "test_it.py").write_text(FAILING)
    for arguments in (["--tactemu-truth-dir", "test_it.py/kept"], ["-o", "tactemu_truth_dir=test_it.py", "-n", "2"]):
        done = run_pytest(tmp_path, *arguments)
        assert done.returncode == 4 and "Traceback" not in done.stderr + done.stdout, done.stdout
        assert "cannot write truth logs of failed tests" in done.stderr and "Not a directory" in done.stderr


MARKED = """
import pytest

pytestmark = pytest.mark.tactemu(rate_hz=50, seed=1)

class TestBoth:
    pytestmark = pytest.mark.tactemu(seed=2)

    def test_the_closest_marker_wins(self, tactile_device):
        device = tactile_device("anyskin")
        assert device.simulation.context.seed == 2
        assert device.emulator.channels[0].rates_hz() == {"": 50.0}

    @pytest.mark.timeout(2)
    @pytest.mark.parametrize("name", ["a_b", "a-b"])
    def test_hangs(self, tactile_device, name):
        tactile_device("anyskin").wait(100)

def test_without():
    pass
"""


def test_markers_give_options_and_choose_tests_and_a_time_limit_ends_one_that_waits(tmp_path):
    (tmp_path / "test_it.py").write_text(MARKED)
    done = run_pytest(tmp_path, "--strict-markers", "-m", "tactemu", "-k", "not without", "--tactemu-truth-dir=kept")
    assert "2 failed, 1 passed" in done.stdout, done.stdout
    assert done.stdout.count("Timeout") >= 2
    assert len(list((tmp_path / "kept").glob("*hangs*.mcap"))) == 2, "names that differ in a sign only"
    assert "pytest.mark.tactemu" in run_pytest(tmp_path, "--markers").stdout


def test_only_tests_with_a_device_are_chosen_by_the_marker(tmp_path):
    (tmp_path / "test_it.py").write_text("def test_one(tactile_device): pass\ndef test_two(): pass\n")
    assert "1/2 tests collected" in run_pytest(tmp_path, "--strict-markers", "-m", "tactemu", "--collect-only").stdout
    (tmp_path / "test_it.py").write_text("import pytest\n@pytest.mark.tactemu(7)\ndef test_one(): pass\n")
    done = run_pytest(tmp_path)
    assert done.returncode == 4 and "takes options by name, such as rate_hz=200" in done.stdout + done.stderr


WRONG = """
import pytest

@pytest.fixture
def device(tactile_device):
    return tactile_device("anyskn")

def test_its_fixture(device):
    pass

def test_its_argument(tactile_device):
    tactile_device("anyskin").press(depth=9)

def test_its_option(tactile_device):
    tactile_device("anyskin", colour="red")

def test_in_the_background(tactile_device):
    tactile_device("anyskin").emulator.call(lambda: {}["of the user"])
"""
MESSAGES = ("unknown device 'anyskn'", "press: depth must be", "unexpected keyword argument 'colour'", "of the user")


def test_a_message_for_the_user_has_only_the_frames_of_the_user(tmp_path):
    (tmp_path / "test_it.py").write_text(WRONG)
    for arguments, hides in (([], True), (["-n", "1"], True), (["--full-trace"], False), (["--tb=native"], False)):
        shown = run_pytest(tmp_path, *arguments).stdout
        assert "2 failed, 1 passed, 2 errors" in shown and all(message in shown for message in MESSAGES), shown
        assert ("serving.py" not in shown and "command_registry.py" not in shown) == hides, shown


def test_an_error_that_tactemu_did_not_raise_on_purpose_has_all_its_frames(tmp_path):
    broken = "from unittest import mock\ndef test_it(tactile_device):\n"
    broken += "    with mock.patch('tactemu.session.session.assemble', None):\n        tactile_device('anyskin')\n"
    (tmp_path / "test_it.py").write_text(broken)
    assert all(name in run_pytest(tmp_path).stdout for name in ("session.py", "TypeError: 'NoneType' object is not"))
