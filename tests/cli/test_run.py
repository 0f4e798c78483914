"""``tactemu run``: a line when ready, a clean end, and every mistake a message, exit code 2, nothing left behind."""

import gc
import json
import os
import re
import signal
from pathlib import Path

import pytest
import serial

from tactemu.base.errors import SceneError
from tactemu.cli.words import quantity, rate_of
from tactemu.control import endpoints
from tests.cli.command import ROOT, here, start, tactemu


def ready(process) -> dict:
    return json.loads(process.stdout.readline())


@pytest.fixture
def port(tmp_path) -> Path:
    return tmp_path / "skin"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_port_is_there_until_a_signal_ends_it(port, number):
    name = f"ended-by-{number}-{os.getpid()}"
    process = start(
        "run", "anyskin", "--port", f"pty:{port}", "--json", "--name", name,
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),  # it may be ignored here, as nohup does
    )  # fmt: skip
    try:
        line = ready(process)
        assert line == {
            "event": "ready", "skin": "anyskin", "device": "anyskin", "port": str(port), "rate_hz": 100.0,
            "firmware_rate_hz": 100.0,
        }  # fmt: skip
        with serial.Serial(str(port), 115200, timeout=5) as driver:
            stream = driver.read(5 * 82)
        assert len(stream) == 5 * 82
        assert stream[80:82] == b"\r\n"
        process.send_signal(number)
        out, err = process.communicate(timeout=10)
    finally:
        process.kill()
    assert process.returncode == 0
    assert err == ""
    summary = next(entry for entry in map(json.loads, out.splitlines()) if entry["event"] == "summary")
    assert summary["samples"] >= 5
    assert summary["wire"]["sent"] >= 5
    assert not os.path.lexists(port)
    assert not list(endpoints.folder().glob(f"{name}.*"))


def test_plain_lines_where_there_is_no_terminal(port):
    done = tactemu("run", "anyskin", "--port", f"pty:{port}", "--seconds", "1.5")
    assert done.returncode == 0, done.stderr
    first, *reports, last = [line for line in done.stdout.splitlines() if "not taken in time" not in line]
    assert first == f"anyskin ready on {port} at 100 Hz"
    assert len(reports) == 1
    assert re.match(r"summary anyskin: \d+ samples at \d+\.\d Hz, late p50/p99/max \d+/\d+/\d+ us", last)
    assert done.stderr == ""


def test_the_virtual_clock_is_fast_and_repeats_itself(tmp_path):
    logs = [tmp_path / "a.jsonl", tmp_path / "b.jsonl"]
    begun = os.times().children_user
    for log in logs:
        done = tactemu(
            "run",
            "anyskin",
            "--port",
            "memory:",
            "--clock",
            "virtual",
            "--seconds",
            "10",
            "--seed",
            "5",
            "--truth",
            str(log),
        )
        assert done.returncode == 0, done.stderr
    assert os.times().children_user - begun < 20, "20 s of emulation, on however busy a machine"
    assert logs[0].read_bytes() == logs[1].read_bytes()
    assert logs[0].stat().st_size > 100_000


SCENE = """
[[body]]
name = "pad"
shape = "box"
size = [0.03, 0.03, 0.006]
fixed = true
[[body]]
name = "thing"
shape = "mesh"
path = "thing.stl"
[[skin]]
device = "anyskin"
link = "pad"
options = { noise = 0.1 }
"""

WRONG = {
    "unknown device": (["anyskn"], "unknown device 'anyskn'; did you mean 'anyskin'?"),
    "no scene file": (["none.toml"], "none.toml: cannot read the scene file"),
    "wrong key": (["key.toml"], "body[0] 'pad': unknown key 'sze'; did you mean 'size'?"),
    "wrong option": (["option.toml"], "has no 'nose'; did you mean 'noise'?"),
    "mesh that is not there": (["missing.toml"], "no such mesh file"),
    "mesh that does not load": (["mesh.toml"], "broken.stl"),
    "unknown scheme": (["anyskin", "--port", "usb:1"], "unknown scheme 'usb'"),
    "folder that does not exist": (["anyskin", "--port", "pty:/nonexistent/x"], "/nonexistent"),
    "path that is taken": (["anyskin", "--port", "pty:taken"], "taken"),
    "CAN interface that does not exist": (["xela_uskin", "--port", "can:socketcan:nocan7"], "nocan7"),
    "unknown kind of CAN": (["xela_uskin", "--port", "can:nothing:0"], "nothing"),
    "wrong connector": (["xela_uskin", "--port", "pty:skin"], "connector"),
    "port out of range": (["anyskin", "--port", "tcp:127.0.0.1:99999"], "99999"),
    "rate": (["anyskin", "--rate", "-5"], "rate must be >= 0.001 and <= 1e+06 Hz, got -5"),
    "compute device": (["anyskin", "--device", "cuda:77"], "no device 'cuda:77'"),
    "fault": (["anyskin", "--fault", "dorp 1%"], "did you mean 'drop'?"),
    "fault of another wire": (["anyskin", "--fault", "busoff at 1s"], "a serial wire cannot have it"),
    "model that does not sense it": (["senses.toml"], "contact_probe provides touch and not force"),
    "several ports of nobody": (["two.toml", "--port", "memory:", "--port", "pty:x"], "--port SKIN=memory:"),
    "two ports for one skin": (["two.toml", "--port", "other=memory:a", "--port", "other=pty:x"], "has a port already"),
    "port of a skin that is not there": (["two.toml", "--port", "toe=memory:"], "no port 'toe' (ports: "),
    "one port for two skins": (["two.toml", "--port", "pty:both"], "cannot share pty:both"),
    "virtual without an end": (["anyskin", "--clock=virtual"], "--seconds"),
    "truth file": (["anyskin", "--truth", "/nonexistent/t.jsonl"], "cannot write the truth log"),
    "NaN in a motion": (["nan.toml"], "must be >= -100 and <= 100 m (6 mm is 0.006), got nan"),
    "device file without a class": (["empty.py"], "name the class in it, as empty.py:Class"),
    "device file without the class": (["empty.py:Skin"], "has no class 'Skin'"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("wrong")
    (path / "taken").write_text("somebody's file")
    (path / "broken.stl").write_text("this is no mesh")
    (path / "empty.py").write_text("")
    scenes = {
        "missing": SCENE,
        "senses": SCENE.replace("options = { noise = 0.1 }", 'model = "contact_probe"').replace(
            'shape = "mesh"\npath = "thing.stl"', 'shape = "plane"'
        ),
        "two": SCENE + '[[skin]]\nname = "other"\ndevice = "anyskin"\nlink = "pad"\n',
        "mesh": SCENE.replace("thing.stl", "broken.stl"),
        "key": SCENE.replace("size", "sze"),
        "option": SCENE.replace("noise", "nose").replace('shape = "mesh"\npath = "thing.stl"', 'shape = "plane"'),
        "nan": SCENE.replace(
            'shape = "mesh"\npath = "thing.stl"', 'shape = "sphere"\nradius = 1\nposition = [0, 0, nan]'
        ),
    }
    for name, text in scenes.items():
        (path / f"{name}.toml").write_text(text)
    return path


def left(*folders: Path) -> list[Path]:
    """What a run could leave behind: files beside its scene; in the temporary folder ports and a control socket.

    Python itself leaves the byte code of a device's file.
    """
    return sorted(path for folder in folders for path in folder.rglob("*") if "__pycache__" not in path.parts)


@pytest.mark.parametrize("name", WRONG)
def test_a_mistake_is_a_message_and_leaves_nothing(name, folder, tmp_path, monkeypatch):
    arguments, says = WRONG[name]
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))  # the usual one has the ports of whoever else runs here
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    before = left(folder)
    done = here("run", *arguments, *(["--json"] if "--clock=virtual" in arguments else ["--seconds", "1"]), cwd=folder)
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.startswith("tactemu: ")
    assert says in done.stderr
    assert "ready" not in done.stdout
    assert left(folder) == before
    # The lock of the control sockets stays: to remove it would be a race between two that start.
    assert [path for path in left(tmp_path) if not path.is_dir() and path.name != ".lock"] == []


def test_each_skin_has_its_own_port(tmp_path):
    ports = ["--port", "palm=memory:one", "--port", "fingertip=memory:two"]
    done = here("run", str(ROOT / "examples" / "hand.toml"), *ports, "--clock=virtual", "--seconds", "0.1", "--json")
    assert done.returncode == 0, done.stderr
    ready = [json.loads(line) for line in done.stdout.splitlines() if '"ready"' in line]
    assert {entry["skin"]: entry["port"] for entry in ready} == {"palm": "memory:one", "fingertip": "memory:two"}


def test_the_exit_status_of_a_mistake_and_no_traceback():
    done = tactemu("run", "anyskn")
    assert done.returncode == 2 and done.stdout == "" and done.stderr.count("\n") == 1


def test_a_reader_that_has_had_enough_ends_it_quietly(port):
    process = start("run", "anyskin", "--port", f"pty:{port}")
    process.stdout.readline()
    process.stdout.close()
    try:
        assert process.wait(timeout=20) == 1, "as a command in a pipe does"
        assert process.stderr.read() == ""
    finally:
        process.kill()
    assert not os.path.lexists(port)


@pytest.mark.parametrize(
    ("words", "rate"),
    [
        ((), None),
        (("200",), 200.0),
        (("100Hz",), 100.0),
        (("touch=200", "imu=1e3"), {"touch": 200.0, "imu": 1000.0}),
        (("touch=200 Hz", "imu=1kHz"), {"touch": 200.0, "imu": 1000.0}),
    ],
)
def test_rates_are_read_as_numbers_or_by_stream(words, rate):
    assert rate_of(words) == rate


@pytest.mark.parametrize(
    ("text", "seconds"), [("2s", 2.0), ("500ms", 0.5), ("5m", 300.0), ("1.5 h", 5400.0), (3.0, 3.0)]
)
def test_a_duration_may_have_a_unit(text, seconds):
    assert quantity("--seconds", text, "Seconds") == seconds


@pytest.mark.parametrize("words", [("fast",), ("touch=",), ("100", "200"), ("touch=1", "2")])
def test_what_is_no_rate_is_said(words):
    with pytest.raises(SceneError, match="--rate"):
        rate_of(words)


@pytest.mark.parametrize(
    "arguments", [("anyskin", "--port=memory:", "--clock=virtual", "--seconds=0.01"), ("nothing",)]
)
def test_the_program_that_runs_it_has_its_garbage_collections_back(arguments):
    """Also where it was refused before a loop began: garbage of minutes would wait for the next loop."""
    before = gc.isenabled(), gc.get_threshold()
    assert here("run", *arguments).returncode == (0 if len(arguments) > 1 else 2)
    assert (gc.isenabled(), gc.get_threshold()) == before
