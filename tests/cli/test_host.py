"""What the machine gives: ``tactemu check-host`` says so, and its exit status is for scripts; ``run --preempt``."""

import json
import os

from tactemu.base.priority import can_enable_realtime_priority
from tactemu.cli import host_timing
from tactemu.cli.check_host import CHECKS
from tactemu.cli.host_timing import TIMING_CHECKS
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


def test_what_a_container_does_not_show_is_no_reason_to_fail(monkeypatch, tmp_path):
    monkeypatch.setattr(host_timing, "SYSTEM", tmp_path)
    monkeypatch.setattr(host_timing, "PROCESSES", tmp_path)
    monkeypatch.setattr(host_timing, "_WATCH_S", 0.01)
    found = {name: TIMING_CHECKS[name](name) for name in ("neighbours", "quota", "governor")}
    assert all(each.there and each.says and not each.helps for each in found.values())
    assert "no CPU is kept free" in TIMING_CHECKS["isolated"]("isolated").says


def test_what_makes_samples_late_is_named_with_what_helps(monkeypatch, tmp_path):
    monkeypatch.setattr(host_timing, "SYSTEM", tmp_path)
    for path, text in {
        "fs/cgroup/cpu.max": "50000 100000",
        "devices/system/cpu/isolated": "2-3",
        "devices/system/cpu/cpu0/cpufreq/scaling_governor": "powersave",
        "devices/system/cpu/cpu0/cpuidle/state0/latency": "0",
        "devices/system/cpu/cpu0/cpuidle/state0/name": "POLL",
        "devices/system/cpu/cpu0/cpuidle/state1/latency": "170",
        "devices/system/cpu/cpu0/cpuidle/state1/name": "C6",
    }.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text + "\n")
    quota, governor, isolated = (TIMING_CHECKS[name](name) for name in ("quota", "governor", "isolated"))
    assert not quota.there and "0.5 CPUs" in quota.says
    assert not governor.there and "powersave" in governor.says and "C6" in governor.says
    assert "frequency-set -g performance" in governor.helps and "idle-set" in governor.helps
    assert isolated.there and "taskset -c 2-3" in isolated.says


def test_busy_programs_are_named(monkeypatch, tmp_path):
    monkeypatch.setattr(host_timing, "PROCESSES", tmp_path)
    (tmp_path / "77").mkdir()

    def write(ticks):
        (tmp_path / "stat").write_text(f"cpu  {ticks} 0 0 0 0 0 0 {ticks} 0 0\ncpu0 ...\n")
        (tmp_path / "77" / "stat").write_text(f"77 (a (busy) one) R {' '.join(['0'] * 10)} {ticks} 0 0 0\n")

    write(0)
    monkeypatch.setattr(host_timing.time, "sleep", lambda seconds: write(10**6))
    finding = TIMING_CHECKS["neighbours"]("neighbours")
    assert not finding.there and "a (busy) one" in finding.says and "the host of this virtual machine" in finding.says
    assert "--preempt" in finding.helps


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
