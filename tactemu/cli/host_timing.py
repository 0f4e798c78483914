"""The checks of ``tactemu check-host`` of time: the rates that a loop holds on this machine, and what makes it late.

Whatever a container or a virtual machine does not show is said to be unknown, and is no reason to fail.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from tactemu.base.clock import RealClock
from tactemu.base.low_latency import SLICE_NS, low_latency, time_slice_ns, timer_slack_ns
from tactemu.base.priority import can_enable_realtime_priority
from tactemu.base.statistics import Lateness
from tactemu.cli.finding import Finding

SYSTEM = Path("/sys")
PROCESSES = Path("/proc")
_LOOPS = 3000
_PERIOD_NS = 1_000_000
_MAX_LATENESS_P99_MS = 5.0
"""Maximum 99th percentile of a loop's lateness; a later one cannot keep a sensor's rate."""
_RATES_HZ = (2000, 1000, 500, 200, 100, 50, 20)
_WATCH_S = 1.0
"""The time for which other programs are watched."""
_MAX_BUSY_CPUS = 0.1
"""Maximum processor time of other programs per second; more makes samples late now and then."""
_MAX_STOLEN_SHARE = 0.005
_MAX_IDLE_EXIT_US = 50
"""Maximum time that a processor may need to leave its deepest idle state."""


def _text(path: Path) -> str:
    """Return the content of a small file; empty where the system does not show it."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


def _texts(folder: Path, pattern: str) -> list[str]:
    return [text for path in sorted(folder.glob(pattern)) if (text := _text(path))]


def _loop(name: str) -> Finding:
    clock, late = RealClock(), Lateness()
    with low_latency():
        for k in range(1, _LOOPS + 1):
            clock.wait(k * _PERIOD_NS, [])
            late.add(max(0, clock.now_ns() - k * _PERIOD_NS))
    p50, p99, p999, most = (late.percentile_ns(q) / 1e6 for q in (50, 99, 99.9, 100))
    held = next((rate for rate in _RATES_HZ if p999 < 500 / rate), 0)  # half the period is left for the sample
    says = (
        f"late by {p50:.2f} ms (median), {p99:.2f} ms (99 of 100), {most:.2f} ms (once) at 1 kHz; "
        + (f"this machine holds {held} Hz" if held else f"this machine does not hold {_RATES_HZ[-1]} Hz")
        + f" now; {os.cpu_count()} CPUs"
    )
    values = {"p50_ms": p50, "p99_ms": p99, "p999_ms": p999, "max_ms": most, "holds_hz": float(held)}
    is_good = p99 < _MAX_LATENESS_P99_MS
    return Finding(name, is_good, says, "" if is_good else "see the checks below for what to change", values)


def _wake_up(name: str) -> Finding:
    with low_latency():
        slack_ns, slice_ns = timer_slack_ns(), time_slice_ns()
    says = f"the loop has a timer slack of {slack_ns} ns" if slack_ns else "timer slack is unknown here"
    if slice_ns == SLICE_NS:
        return Finding(name, True, f"{says} and a time slice of {slice_ns / 1e6:g} ms: it runs soon after it wakes up")
    helps = "use Linux 6.12 or later: its scheduler runs threads with short time slices sooner"
    return Finding(name, False, f"{says}; the scheduler gives every thread the same time slice", helps)


def _neighbours(name: str) -> Finding:
    before, began = _processor_times(), time.monotonic()
    own = time.process_time()
    time.sleep(_WATCH_S)
    seconds, own = time.monotonic() - began, time.process_time() - own
    after = _processor_times()
    if not after:
        return Finding(name, True, "unknown: the system does not show other programs")
    spent, ticks_in_all = after - before, seconds * os.sysconf("SC_CLK_TCK")
    busy, stolen = spent["busy"] / ticks_in_all - own / seconds, spent["stolen"] / ticks_in_all
    programs = [(text, ticks / ticks_in_all) for text, ticks in spent.most_common() if text not in ("busy", "stolen")]
    most = ", ".join(f"{text.partition(' ')[2]} ({share:.1f})" for text, share in programs[:3] if share > 0.05)
    is_quiet, cpus = busy < _MAX_BUSY_CPUS, os.cpu_count() or 1
    has_own_processors = stolen < _MAX_STOLEN_SHARE * cpus
    says = f"other programs use {max(0.0, busy):.1f} of {cpus} CPUs" + (f": {most}" if most and not is_quiet else "")
    if not has_own_processors:
        says += f"; the host of this virtual machine takes {100 * stolen / cpus:.0f} % of the time"
    helps = "stop them, give the emulator a CPU of its own (taskset), or run it with --preempt"
    if is_quiet and not has_own_processors:
        helps = "give the virtual machine processors of its own"
    values = {"busy_cpus": max(0.0, busy), "stolen_cpus": stolen}
    is_good = is_quiet and has_own_processors
    return Finding(name, is_good, says, "" if is_good else helps, values)


def _processor_times() -> Counter[str]:
    """Return the processor time that all programs have had, that the host took, and by other program [clock ticks]."""
    total = _text(PROCESSES / "stat").partition("\n")[0].split()[1:]
    if len(total) < 8:
        return Counter()
    user, nice, system, _, _, irq, softirq, steal = map(int, total[:8])
    found = Counter(busy=user + nice + system + irq + softirq, stolen=steal)
    for path in PROCESSES.glob("[0-9]*/stat"):
        head, _, rest = _text(path).rpartition(")")
        if rest and path.parent.name != str(os.getpid()):
            number, _, program = head.partition(" (")
            ticks = rest.split()
            found[f"{number} {program}"] = int(ticks[11]) + int(ticks[12])
    return found


def _quota(name: str) -> Finding:
    quota, _, period = (_text(SYSTEM / "fs/cgroup/cpu.max") or "max").partition(" ")
    if quota == "max":  # version 1 of control groups
        quota, period = (_text(SYSTEM / f"fs/cgroup/cpu/cpu.cfs_{what}_us") for what in ("quota", "period"))
    if quota.isdigit() and period.isdigit() and int(period):
        share = int(quota) / int(period)
        says = f"this container may use {share:g} CPUs, and then stands still for the rest of {int(period) / 1e3:g} ms"
        return Finding(name, share >= 2, says, "" if share >= 2 else "start it without a limit (docker run --cpus)")
    allowed = len(os.sched_getaffinity(0))
    return Finding(name, True, f"no limit of processor time; {allowed} CPUs may be used")


def _governor(name: str) -> Finding:
    folder = SYSTEM / "devices/system/cpu"
    found = Counter(_texts(folder, "cpu[0-9]*/cpufreq/scaling_governor"))
    depths = {
        int(us): title
        for us, title in zip(
            _texts(folder, "cpu0/cpuidle/state*/latency"), _texts(folder, "cpu0/cpuidle/state*/name"), strict=False
        )
        if us.isdigit()
    }
    deepest_us = max(depths, default=0)
    says, helps = [], []
    if not found:
        says.append("clock speed: not shown here (a virtual machine, or a container)")
    elif set(found) == {"performance"}:
        says.append("clock speed: full (performance)")
    else:
        says.append(f"clock speed: follows the load ({', '.join(found)})")
        helps.append("sudo cpupower frequency-set -g performance")
    if deepest_us > _MAX_IDLE_EXIT_US:
        says.append(f"idle CPUs sleep so deeply ({depths[deepest_us]}) that they wake up after {deepest_us} µs")
        helps.append(f"sudo cpupower idle-set -D {_MAX_IDLE_EXIT_US}")
    return Finding(name, not helps, "; ".join(says), "; ".join(helps))


def _priority(name: str) -> Finding:
    if can_enable_realtime_priority():
        return Finding(name, True, "real-time priority: `tactemu run --preempt` goes before other programs")
    says = "no right to real-time priority"
    helps = f"add the line '{os.environ.get('USER', 'USER')} - rtprio 1' to /etc/security/limits.conf, log in again"
    return Finding(name, False, says, helps)


def _isolated(name: str) -> Finding:
    isolated, last = _text(SYSTEM / "devices/system/cpu/isolated"), (os.cpu_count() or 1) - 1
    if isolated:
        helps = f"taskset -c {isolated} tactemu run ..."
        return Finding(name, True, f"CPUs without other programs: {isolated}; use one by: {helps}")
    helps = f"start the kernel with isolcpus={last}, then: taskset -c {last} tactemu run ..." if last else ""
    return Finding(name, False, "no CPU is kept free of other programs", helps)


TIMING_CHECKS: dict[str, Callable[[str], Finding]] = {
    "loop": _loop, "wake-up": _wake_up, "neighbours": _neighbours, "quota": _quota, "governor": _governor,
    "priority": _priority, "isolated": _isolated,
}  # fmt: skip
"""The checks, in the order of their output."""
