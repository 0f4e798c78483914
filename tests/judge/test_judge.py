"""Tests of the complete command on live drivers, and on programs that cannot be judged.

:mod:`tests.judge.planted` has every mistake on every kind of line, :mod:`tests.judge.clean` the correct drivers.
"""

import contextlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tactemu.judge.processes import MARK, marked
from tactemu.judge.trial_runner import Judge, JudgeOptions
from tests.cli.command import here
from tests.scenes import ball, pad

pytestmark = [pytest.mark.timeout(300)]

DRIVERS = Path(__file__).with_name("drivers")
NO_SUM = [sys.executable, str(DRIVERS / "over_stream.py"), "nosum", "{port}"]


def ended(command):
    return subprocess.run(command, check=False, capture_output=True, text=True, timeout=120)


def test_a_sum_that_nobody_checks_with_report_case_and_replay(tmp_path):
    """Check the complete command: exit code, files, and the smallest case."""
    command = ["--", *NO_SUM]
    files = {name: tmp_path / f"r.{name}" for name in ("html", "junit", "json")}
    arguments = [f"--{name}={path}" for name, path in files.items()]
    base = [sys.executable, "-m", "tactemu", "judge", "optoforce"]
    more = ["--only=flipped", "--rest=0.2", f"--cases={tmp_path / 'cases'}", f"--record={tmp_path / 'records'}"]
    first = ended([*base, *arguments, *more, *command])
    assert first.returncode == 1, first.stderr
    assert "silent wrong values" in first.stderr and "Fx, in counts" in first.stderr
    (case,) = (tmp_path / "cases").iterdir()
    data = json.loads(case.read_text())
    assert len(data["faults"]) == 1 and data["finding"] == "wrong" and data["odd"]
    byte = int(data["faults"][0].split()[4])
    assert 8 <= byte <= 13, "a byte of a value"
    assert ElementTree.parse(files["junit"]).getroot().get("failures") == "1"
    assert json.loads(files["json"].read_text())["failed"] == ["flipped"] and "<svg" in files["html"].read_text()
    names = sorted(path.stem for path in (tmp_path / "records").iterdir())
    assert [name[3:] for name in names] in (["clean", "flipped"], ["clean", "clean", "flipped"])  # on a busy machine


FLAWED = [
    (["--only=flapped"], 2, "--only: no trial 'flapped'; did you mean 'flipped'?"),
    (["--html=/no/such/folder/r.html"], 2, "there is no folder /no/such/folder"),
    (["--cases=/dev/null/x"], 2, "/dev/null/x: cannot write the cases: /dev/null: Not a directory"),
    (["--record=/dev/null/x"], 2, "/dev/null/x: cannot write the recorded trials: /dev/null: Not a directory"),
    (["--columns=/no/x.toml"], 2, "/no/x.toml: cannot write the columns: there is no folder /no"),
    (["--budget=1s"], 3, "only the run without faults was tried"),
    (["--only=clean"], 0, "nothing fails"),
]


@pytest.mark.parametrize(("options", "status", "says"), FLAWED)
def test_a_request_that_would_judge_nothing_does_not_pass(options, status, says):
    done = here("judge", "optoforce", *options, "--", *NO_SUM)
    assert done.returncode == status and says in " ".join(done.stderr.split()), done.stderr


@pytest.mark.parametrize("name", ["cases/byte-lost.json", "record/03-flipped.jsonl"])
def test_a_folder_with_a_file_of_another_program_is_refused_before_the_driver_starts(name, tmp_path):
    path = tmp_path / name
    path.parent.mkdir()
    path.write_text("an hour of work")
    (path.parent / "package.json").write_text("no trial has this name")
    started = tmp_path / "started"
    driver = ["--", "touch", str(started), "{port}"]
    done = here("judge", "optoforce", f"--{path.parent.name}={path.parent}", *driver)
    assert done.returncode == 2 and f"{path}: was not written by tactemu and is not overwritten" in done.stderr
    assert path.read_text() == "an hour of work" and not started.exists()


@pytest.mark.nightly
def test_a_case_is_tried_alone_and_a_baseline_forgives_it(tmp_path):
    base = [sys.executable, "-m", "tactemu", "judge", "optoforce"]
    command = ["--", *NO_SUM]
    report = tmp_path / "report.json"
    assert ended([*base, "--only=flipped", f"--json={report}", f"--cases={tmp_path / 'c'}", *command]).returncode == 1
    (case,) = (tmp_path / "c").iterdir()
    alone = ended([*base, f"--replay={case}", *command])
    assert alone.returncode == 1 and "1 of 2 trials fail" in alone.stderr
    forgiven = ended([*base, f"--baseline={report}", f"--replay={case}", *command])
    assert forgiven.returncode == 0 and "as in the baseline" in forgiven.stderr, forgiven.stderr


@pytest.mark.nightly
def test_a_reader_in_python_is_called_and_may_be_late(tmp_path):
    (tmp_path / "mine.py").write_text(
        "import os, serial, struct, time\n"
        "def read():\n"
        "    line = serial.Serial(os.environ['TACTEMU_PORT'], timeout=1)\n"
        "    while True:\n"
        "        line.read_until(bytes.fromhex('aa07080a'))\n"
        "        packet = line.read(12)\n"
        "        time.sleep(0.02)\n"
        "        line.reset_input_buffer()\n"
        "        yield {'f': struct.unpack('>3h', packet[4:10])}\n"
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)
        from tactemu.judge.driver import reading_command

        with Judge("optoforce", reading_command("mine:read"), JudgeOptions(only=["clean"])) as judge:
            (outcome,) = judge.run()
    assert [column.channel for column in judge.columns.values] == [0, 1, 2]
    assert outcome.p50_ms is not None and 20.0 < outcome.p50_ms < 30.0


BAD = {
    "exits at once": ("import sys; sys.exit('no such sensor')", "exits with status 1", "no such sensor"),
    "says nothing": ("import time; time.sleep(60)", "prints nothing within", "does not open the port"),
    "talks": ("import time\nwhile 1: print('hi', flush=True); time.sleep(.1)", "nothing that holds numbers", "hi"),
    "prints what is no reading": (
        "import random, time\nwhile 1: print(random.random(), random.random(), flush=True); time.sleep(.002)",
        "no row is a reading that was sent", "0, 1",
    ),
    "needs a terminal": ("import curses; curses.initscr(); input()", "exits with status 1", "EOF"),
    "floods": ("import os\nwhile 1: os.write(1, b'x' * 65536)", "prints more than 8 MB", ""),
    "leaves": (
        "import os, time\nif os.fork(): os._exit(0)\nos.setsid()\nif os.fork(): os._exit(0)\ntime.sleep(60)",
        "exits with status 0", "",
    ),
}  # fmt: skip


def terminals():
    """Return the number of ends of pseudo terminals that this process holds."""
    held = 0
    for fd in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):
            held += os.readlink(f"/proc/self/fd/{fd}").startswith(("/dev/pt", "/dev/pts"))
    return held


@pytest.mark.parametrize("case", BAD)
def test_with_what_is_no_driver_there_is_a_word_and_nothing_left(case):
    """Check that it ends in bounded time, and leaves no process, port or thread behind."""
    script, verdict, last = BAD[case]
    before = terminals()
    with Judge(
        "optoforce",
        [sys.executable, "-c", script],
        JudgeOptions(start_s={"floods": 8.0, "talks": 3.0}.get(case, 1.2), no_contact_s=0.1),
    ) as judge:
        began = time.monotonic()
        (outcome,) = judge.run()
        assert time.monotonic() - began < 120, "also when each is tried twice on a busy machine"
        mark = judge.driver.mark if judge.driver else ""
    assert verdict in outcome.verdict and last in outcome.verdict, outcome.verdict
    assert outcome.fails(judge.options.fail_on) and MARK and not marked(mark)
    assert terminals() == before


def test_a_program_that_is_not_there_is_a_mistake_in_the_command():
    done = ended([sys.executable, "-m", "tactemu", "judge", "optoforce", "--", "no-such-driver", "{port}"])
    assert done.returncode == 2 and "cannot run the driver: no-such-driver" in done.stderr, done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.nightly
def test_a_driver_that_filters_is_learned_from_what_is_held():
    command = [sys.executable, str(DRIVERS / "over_stream.py"), "filter", "{port}"]
    with Judge("optoforce", command, JudgeOptions(only=["flipped", "hang", "reset"])) as judge:
        outcomes = list(judge.run())
    assert not any(outcome.fails(JudgeOptions().fail_on) for outcome in outcomes), [o.verdict for o in outcomes]


TWO_SKINS = (
    pad(0.1, 0.03, 0.006)
    + ball(0.02, [0.0, 0.0, 0.05])
    + """
[[skin]]
name = "left"
device = "optoforce"
link = "pad"
position = [0.03, 0.0, 0.003]
[[skin]]
name = "right"
device = "optoforce"
link = "pad"
position = [-0.03, 0.0, 0.003]
"""
)


@pytest.mark.nightly
def test_two_skins_may_be_out_of_step_but_not_wrong(tmp_path):
    (tmp_path / "two.toml").write_text(TWO_SKINS)
    command = [sys.executable, str(DRIVERS / "over_two_ports.py"), "clean", "{left}", "{right}"]
    with Judge(
        str(tmp_path / "two.toml"), command, JudgeOptions(only=["flipped", "dropped", "hang", "unplug"])
    ) as judge:
        outcomes = list(judge.run())
    assert [column.channel for column in judge.columns.values] == list(range(6)) and len(outcomes) == 5
    assert not any(outcome.fails(JudgeOptions().fail_on) for outcome in outcomes), [o.verdict for o in outcomes]
