"""The pytest plugin, in a pytest of its own."""

import subprocess
import sys

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
    done = run_pytest(tmp_path, "--tactemu-seed", "23")
    assert "2 passed" in done.stdout and "1 failed" in done.stdout and "1 error" in done.stdout, done.stdout
    kept = sorted((tmp_path / "kept").iterdir())
    assert [path.name for path in kept] == [
        "test-it.py-test-bad-1.mcap",
        "test-it.py-test-bad-in-the-background-1.mcap",
    ]
    assert str(kept[0]) in done.stdout
    assert "anyskin" in read_log(kept[0])


def test_a_seed_that_is_none_is_refused_before_any_test_runs(tmp_path):
    done = run_pytest(tmp_path, "--tactemu-seed", "x")
    assert done.returncode == 4 and "--tactemu-seed: expected a whole number, got 'x'" in done.stderr
