"""The command line beside sensors in other processes: behind ptys, sockets and a CAN bus."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.cli.command import here
from tests.judge.compare.sensors import PLANTS

ROOT = Path(__file__).parents[3]
SECONDS = 6.0
LIVE = [name for name in PLANTS if not PLANTS[name].presses]


@contextlib.contextmanager
def sensor(name, address):
    """Yield the address of a sensor in a process of its own."""
    command = [sys.executable, "-m", "tests.judge.compare.sensors", name, address]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process.stdout.readline().strip()
        finally:
            process.stdin.close()
            process.wait()


def address_of(device, tmp_path):
    if device == "cyskin_cpm_finger":
        number = os.getpid() % 250 + 1
        return f"can:udp_multicast:239.74.{number}.{int(time.monotonic()) % 250 + 1}"
    return f"pty:{tmp_path / 'sensor'}"


def source_of(address, tmp_path):
    return address if address.startswith("can:") else str(tmp_path / "sensor")


def compare(device, source, tmp_path, *more, seconds=SECONDS):
    """Run `tactemu compare` in this process; return its end and its JSON report."""
    out = tmp_path / "compared"
    done = here("compare", device, "--from", source, "--out", str(out), "--seconds", str(seconds), *more)
    report = out / "report.json"
    return done, json.loads(report.read_text()) if report.exists() else {}


@pytest.mark.nightly
@pytest.mark.parametrize("name", LIVE)
def test_a_planted_difference_is_named_by_the_command(name, tmp_path):
    plant = PLANTS[name]
    address = address_of(plant.device, tmp_path)
    with sensor(name, address):
        done, report = compare(plant.device, source_of(address, tmp_path), tmp_path)
    found = [f"{each['kind']}: {each['where']}: {each['text']}" for each in report["protocol"]]
    assert [each["kind"] for each in report["protocol"]] == [plant.kind], (found, done.stderr)
    assert done.returncode == 1


def test_a_late_answer_is_named_by_the_command(tmp_path):
    with sensor("late answer", f"pty:{tmp_path / 'sensor'}"):
        done, report = compare("weiss_wts", str(tmp_path / "sensor"), tmp_path, seconds=1)
    assert [each["kind"] for each in report["protocol"]] == ["latency"], done.stderr
    assert done.returncode == 1 and "`matrix`: after 2" in done.stderr


@pytest.mark.nightly
@pytest.mark.parametrize("run", range(20))
@pytest.mark.parametrize("device", ["optoforce", "weiss_wts", "dfrobot_tactile"])
def test_no_run_of_twenty_finds_anything_in_a_sensor_like_its_model(device, run, tmp_path):
    with sensor(device, f"pty:{tmp_path / 'sensor'}"):
        done, report = compare(device, str(tmp_path / "sensor"), tmp_path)
    assert (report["protocol"], done.returncode) == ([], 0), done.stderr


@pytest.mark.parametrize(
    ("device", "address", "more"),
    [
        ("inspire_rh56dftp", "tcp:127.0.0.1:0", ["--port", "tcp"]),
        ("ati_wireless_ft", "udp:127.0.0.1:0", ["--ask-all"]),
        pytest.param("ati_net_ft", "udp:127.0.0.1:0", ["--ask-all"], marks=pytest.mark.nightly),
    ],
)
def test_a_sensor_on_the_network_agrees(device, address, more, tmp_path):
    with sensor(device, address) as at:
        done, report = compare(device, at.replace("socket://", "tcp:"), tmp_path, *more, seconds=1)
    assert (report["protocol"], done.returncode) == ([], 0), done.stderr
    assert report["asked"]


@pytest.mark.parametrize("device", ["brainco_revo2", "cyskin_cpm_finger"])
def test_a_sensor_like_its_model_agrees(device, tmp_path):
    address = address_of(device, tmp_path)
    with sensor(device, address):
        done, report = compare(device, source_of(address, tmp_path), tmp_path)
    assert (report["protocol"], done.returncode) == ([], 0), done.stderr
    assert "measured('touch', 'one sensor agrees" in done.stderr
    again, of_capture = compare(device, str(tmp_path / "compared/capture.mcap"), tmp_path / "again")
    assert (of_capture["protocol"], again.returncode) == ([], 0), again.stderr


def test_the_requests_are_printed_before_they_are_sent_and_listening_sends_none(tmp_path):
    with sensor("weiss_wts", f"pty:{tmp_path / 'sensor'}"):
        done, report = compare("weiss_wts", str(tmp_path / "sensor"), tmp_path, seconds=1)
        assert "these requests are sent" in done.stderr and report["asked"]["tag"] >= 6
        assert "no more frames" in report["not_asked"] and "no more frames" not in report["asked"]
        done, report = compare("weiss_wts", str(tmp_path / "sensor"), tmp_path / "2", "--listen", seconds=1)
        assert report["asked"] == {} and "nothing is sent" in done.stderr and done.returncode == 3


def test_ctrl_c_keeps_capture_and_report(tmp_path):
    out = tmp_path / "compared"
    with sensor("optoforce", f"pty:{tmp_path / 'sensor'}"):
        command = [sys.executable, "-m", "tactemu", "compare", "optoforce", "--from", str(tmp_path / "sensor")]
        with subprocess.Popen([*command, "--out", str(out), "--seconds", "600"], cwd=ROOT) as process:
            while not (out / "capture.mcap").exists() or (out / "capture.mcap").stat().st_size < 2000:
                time.sleep(0.05)
                assert process.poll() is None
            process.send_signal(signal.SIGINT)
            assert process.wait() == 130
    report = json.loads((out / "report.json").read_text())
    assert report["interrupted"] and report["evidence"] == ""
    assert "<h1>" in (out / "report.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nonesuch", "--from", "/dev/null"], "nonesuch"),
        (["optoforce", "--from", "/dev/no-such-port"], "cannot open /dev/no-such-port"),
        (["optoforce", "--from", "can:virtual:x"], "optoforce has no port for can:virtual:x; it has: first (Serial)"),
        (["optoforce", "--from", __file__], "unknown format"),
        (["ati_net_ft", "--from", "/dev/null", "--port", "tpc"], "did you mean 'tcp'?"),
        (["optoforce", "--from", "/dev/null", "--listen", "--press"], "--listen sends nothing"),
    ],
)
def test_a_request_that_cannot_be_met_is_one_sentence(arguments, words, tmp_path):
    done = here("compare", *arguments, "--out", str(tmp_path / "out"))
    assert done.returncode == 2 and words in done.stderr and "Traceback" not in done.stderr


def test_a_folder_that_cannot_be_made_is_refused_before_the_sensor_is_opened():
    done = here("compare", "optoforce", "--from", "/dev/no-such-port", "--out", "/dev/null/x")
    said = "tactemu: /dev/null/x: cannot write the reports: /dev/null: Not a directory"
    assert done.returncode == 2 and done.stderr.splitlines() == [said]
