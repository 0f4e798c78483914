"""The pytest plugin, in a pytest of its own."""

import subprocess
import sys

from tests.cli.command import environment, plugin_options

TEST = """
import os
import sys

ports = []

def test_with(tactile_device):
    with tactile_device("anyskin", rate_hz=100, seed=7) as dev:
        ports.append(dev.port)
        dev.press(depth=1e-3, seconds=0.05)
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
