"""What the machine refuses is one sentence and no traceback."""

import subprocess
import sys

import pytest

from tests.cli.command import ROOT, environment, here, tactemu

SCENE = '[[body]]\nname = "a"\nshape = "sphere"\nradius = 0.01\n[[skin]]\ndevice = "anyskin"\nlink = "a"\n'


def shell(script: str) -> subprocess.CompletedProcess[str]:
    command = script.replace("tactemu", f"{sys.executable} -m tactemu")
    return subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, env=environment(), cwd=ROOT, check=False, timeout=60
    )


@pytest.mark.parametrize("command", ["devices", "devices --json", "faults", "--help"])
def test_a_reader_that_goes_is_no_traceback(command):
    done = shell(f"tactemu {command} | head -c 20; exit ${{PIPESTATUS[0]}}")
    assert done.returncode in (0, 1, 141) and done.stderr == ""


@pytest.mark.parametrize("command", ["devices", "run anyskin --port memory: --seconds 0.2 --plain", "devices anyskin"])
def test_an_output_that_is_full_is_one_sentence(command):
    done = shell(f"tactemu {command} > /dev/full")
    assert (done.returncode, done.stderr) == (2, "tactemu: cannot write the output: No space left on device\n")


def test_a_path_that_no_command_has_checked_is_one_sentence(monkeypatch):
    def run():
        open("/no/report.json")

    monkeypatch.setattr("tactemu.cli._run", run)
    done = here("faults")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "tactemu: /no/report.json: there is no folder /no; make it first\n"


@pytest.mark.parametrize(
    ("path", "why"), [("/tmp/" + "a" * 400, "File name too long"), ("/tmp/\\u0000x", "embedded null byte")]
)
def test_a_port_that_no_file_can_be(path, why, tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE + f'port = "pty:{path}"\n')
    done = tactemu("run", str(scene), "--seconds", "0.1")
    assert done.returncode == 2 and not done.stdout
    assert done.stderr.startswith("tactemu: cannot create the port ") and why in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_number_of_thousands_of_digits_is_no_scene(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(f"[scene]\ndt = {'9' * 5000}\n")
    done = here("run", str(scene))
    assert done.returncode == 2 and "not valid TOML: Exceeds the limit (4300 digits)" in done.stderr
