"""SIGINT and SIGTERM end `tactemu run` and `tactemu exec` whenever they come, and the user is told what came."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tactemu.base.clock import RealClock
from tactemu.emulator.emulator import Emulator
from tactemu.truth import read_log
from tests.cli.command import ROOT, environment, start

SLOWEST_S = 4.0
"""Time for an end on a machine with ten times as much to do as it can [s]; on a quiet one it is below 1 s."""


@pytest.fixture
def cached():
    """A run that has compiled what the others need."""
    subprocess.run(
        [sys.executable, "-m", "tactemu", "exec", "-q", "flexitac", "--", "true"], env=environment(), check=True
    )


def test_a_stop_before_the_loop_ends_it():
    emulator = Emulator(None, [], clock=RealClock())
    with emulator:
        emulator.stop()
        begin = time.monotonic()
        emulator.run(5.0)
        assert time.monotonic() - begin < 4
        emulator.run(0.01)
        assert emulator.clock.now_ns() >= 10_000_000, "it ended one run, not the next"


@pytest.mark.parametrize("delay_s", [0, 0, 0.01, 0.02])
def test_a_signal_right_after_the_port_is_there_ends_the_run(delay_s, tmp_path):
    with start("run", "anyskin", "--json", "--port", f"pty:{tmp_path}/skin") as run:
        assert run.stdout and run.stdout.readline()
        time.sleep(delay_s)
        run.send_signal(signal.SIGTERM)
        assert run.wait(10) == 0


START = """
import hashlib, os, signal, sys, time
from tactemu.cli.signals import ended_by_signals, starting
with starting():
    print("up", flush=True)
    {busy}
    with ended_by_signals(lambda: print("stopped")):
        time.sleep({loop})
"""
NATIVE = "hashlib.pbkdf2_hmac('sha256', b'', b'', 1 << 27)"
LOST = "\n    try: time.sleep(60)\n    except KeyboardInterrupt: pass\n    time.sleep({})"


def started(busy: str, loop: float = 0) -> subprocess.Popen[str]:
    code = START.format(busy=busy, loop=loop)
    run = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment()
    )
    assert run.stdout and run.stdout.readline() == "up\n"
    return run


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("busy", ["time.sleep(60)", NATIVE, LOST.format(60), "exec('time.sleep(60)')"])
def test_a_start_ends_whatever_it_is_busy_with(busy, number):
    with started(busy) as run:
        time.sleep(0.1)
        run.send_signal(number)
        out, errors = run.communicate(timeout=10)
    assert (run.returncode, out) == (128 + number, "")
    assert errors == f"tactemu: ended by {number.name} before it had started\n"


def test_a_signal_that_a_library_has_lost_ends_the_loop_at_once():
    with started(LOST.format(0), loop=0.2) as run:
        time.sleep(0.1)
        run.send_signal(signal.SIGTERM)
        assert run.communicate(timeout=10) == ("stopped\n", "")
    assert run.returncode == 0


def test_what_was_made_for_nothing_goes_when_a_start_ends_in_native_code(tmp_path):
    log = tmp_path / "a.mcap"
    busy = f"from tactemu.truth.writer import LogWriter; held = LogWriter('{log}'); {NATIVE}"
    with started(busy) as run:
        while not log.exists():
            time.sleep(0.01)
        time.sleep(0.1)
        run.send_signal(signal.SIGTERM)
        assert run.wait(10) == 128 + signal.SIGTERM
    assert not log.exists()


INTERRUPTED = """
import signal, threading, time
from tactemu.cli.forwarding import forwarded_signals
from tactemu.cli.signals import starting
signal.signal(signal.SIGALRM, lambda *_: None)
with starting() as start, forwarded_signals() as signals:
    thread = next(each for each in threading.enumerate() if each.name == "signals")
    end = time.monotonic() + 1
    while time.monotonic() < end:
        signal.pthread_kill(thread.ident, signal.SIGALRM)
    print(start.number, thread.is_alive())
"""


def test_a_wait_for_signals_that_is_interrupted_makes_none_up():
    """It ended one start of fifty on a busy machine, as if Ctrl-C had been pressed."""
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], check=False, capture_output=True, text=True, env=environment()
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "0 True\n", "")


EARLY = """
import os, signal, sys, time
signal.signal(signal.{0}, signal.SIG_DFL)
class Finder:
    def find_spec(self, name, *_):
        if name == "tactemu.cli.root":
            os.kill(os.getpid(), signal.{0})
            time.sleep(60)
sys.meta_path.insert(0, Finder())
sys.argv = ["tactemu", "exec", "flexitac", "--", "true"]
from tactemu.cli import main
main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_who_sent_a_signal_is_told_from_the_first_import_on(number):
    with subprocess.Popen(
        [sys.executable, "-c", EARLY.format(number.name)], stderr=subprocess.PIPE, text=True, env=environment()
    ) as run:
        _, errors = run.communicate(timeout=20)
    assert errors == f"tactemu: ended by {number.name} from process {run.pid} before it had started\n"
    assert run.returncode == 128 + number


def takes_signals(pid: int) -> bool:
    """Whether a process has a handler for SIGTERM."""
    caught = next(line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("SigCgt"))
    return bool(int(caught.split()[1], 16) >> signal.SIGTERM - 1 & 1)


@pytest.mark.nightly
@pytest.mark.timeout(7200)
def test_two_hundred_starts_end_at_random_moments(cached, tmp_path):
    """Half of them `exec`; every fifth compiles its kernels anew."""
    seed = random.randrange(1 << 32)
    draw, slow = random.Random(seed), []
    for k in range(200):
        log = tmp_path / f"truth{k}.jsonl"
        words = (
            ("run", "flexitac", "--json", "--port", f"pty:{tmp_path}/skin", "--truth", str(log))
            if k % 2
            else ("exec", "-q", "flexitac", "--", "sleep", "60")
        )
        number, delay_s = draw.choice([signal.SIGINT, signal.SIGTERM]), draw.uniform(0.0, 8.0)
        fresh = {"WARP_CACHE_PATH": str(tmp_path / f"kernels{k}")} if k % 10 < 2 else {}
        run = subprocess.Popen(
            [sys.executable, "-m", "tactemu", *words], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
            env=environment() | fresh, cwd=ROOT,
        )  # fmt: skip
        while not takes_signals(run.pid):  # before, the interpreter starts, and whoever runs this may have them ignored
            time.sleep(0.005)
        time.sleep(delay_s)
        run.send_signal(number)
        begin = time.monotonic()
        try:
            _, errors = run.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            run.kill()
            _, errors = run.communicate()
        lasted_s = time.monotonic() - begin
        allowed = (0, 128 + number, -number)
        assert not (log.exists() and read_log(log).is_cut)
        if lasted_s > SLOWEST_S or run.returncode not in allowed or "Traceback" in errors:
            slow.append(
                (k, words[0], number.name, round(delay_s, 2), round(lasted_s, 2), run.returncode, errors[-300:])
            )
    assert not slow, f"seed {seed}: {slow}"
    assert not os.path.lexists(tmp_path / "skin")
