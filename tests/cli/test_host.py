"""What the machine gives: ``tactemu check-host`` says so, and its exit status is for scripts; ``run --preempt``."""

import json
import os

from tactemu.base.priority import can_enable_realtime_priority
from tactemu.cli.check_host import CHECKS
from tests.cli.command import start, tactemu


def test_everything_is_tried_and_said(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    done = tactemu("check-host", "--json", "ports", "python")
    found = json.loads(done.stdout)
    assert list(found) == list(CHECKS) and done.returncode == 0 and all(each["says"] for each in found.values())
    assert found["ports"]["there"] and found["gpu"]["there"] == os.path.exists("/dev/nvidia0")
    assert not found["guest"]["there"] and "apt-get install" in found["guest"]["helps"]
    assert tactemu("check-host", "--json", "guest").returncode == 1
    unknown = tactemu("check-host", "kan")
    assert unknown.returncode == 2 and "python, ports" in unknown.stderr and "kan" in unknown.stderr


def test_an_emulator_goes_before_other_programs_where_it_may():
    run = start("run", "anyskin", "--port", "memory:", "--preempt", "--json", "--seconds", "0.5")
    assert run.stdout is not None
    if not can_enable_realtime_priority():
        assert run.wait(60) == 2 and "limits.conf" in run.communicate()[1]
        return
    assert '"ready"' in run.stdout.readline()
    assert os.sched_getscheduler(run.pid) == os.SCHED_RR
    run.communicate(timeout=60)


def test_what_nothing_makes_late_needs_no_priority():
    done = tactemu("run", "anyskin", "--port", "memory:", "--preempt", "--clock", "virtual", "--seconds", "1")
    assert done.returncode == 2 and "--clock virtual" in done.stderr
