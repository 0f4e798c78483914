"""``tactemu exec``: exit status, signals, streams and terminal of the driver are those of the command."""

import contextlib
import os
import pty
import shutil
import signal
import subprocess
import sys
import time

import pytest

from tactemu.exec import reach
from tests.cli.command import environment, here, start, tactemu

RUN = ("exec", "-q", "flexitac", "--")


def test_what_cannot_be_done_is_said_before_anything_is_built(tmp_path):
    script = tmp_path / "plain.txt"
    script.write_text("no program")
    for status, words, text in (
        (125, ("exec", "flexitac"), "name it after --"),
        (125, ("exec", "flexitak", "--", "true"), "did you mean 'flexitac'?"),
        (125, ("exec", "flexitac", "--node", "COM3", "--", "true"), "expected ttyUSB or ttyACM and a number"),
        (126, ("exec", "flexitac", "--", str(script)), "not executable"),
        (127, ("exec", "flexitac", "--", "no-such-program"), "not found"),
    ):
        done = here(*words)
        assert (done.returncode, done.stdout) == (status, "") and text in done.stderr


def test_streams_status_and_preloaded_libraries_pass_through():
    script = "cat; echo said >&2; echo $LD_PRELOAD; ls /dev/ttyUSB0; exit 7"
    done = subprocess.run(
        [sys.executable, "-m", "tactemu", *RUN, "sh", "-c", script], input="heard\n", capture_output=True, text=True,
        env=environment() | {"LD_PRELOAD": "libdl.so.2"}, timeout=60, check=False,
    )  # fmt: skip
    heard, preload, node = done.stdout.splitlines()
    assert (done.returncode, heard, node, done.stderr) == (7, "heard", "/dev/ttyUSB0", "said\n")
    assert preload.endswith("/preload.so:libdl.so.2")


def test_a_signal_goes_to_the_driver_and_its_end_is_ours():
    script = (
        "import os, signal, sys, time\n"
        "signal.signal(signal.SIGTERM, lambda *_: print('TERM', flush=True))\n"
        "print('up', flush=True); signal.pause(); signal.pause()"
    )
    with start(*RUN, sys.executable, "-c", script) as run:
        assert run.stdout and run.stderr and run.stdout.readline() == "up\n"
        run.send_signal(signal.SIGTERM)
        assert run.stdout.readline() == "TERM\n", "it may go on"
        run.send_signal(signal.SIGHUP)
        begin = time.monotonic()
        assert run.wait(5) == 128 + signal.SIGHUP
        assert time.monotonic() - begin < 1.0


def test_the_drivers_terminal_is_ours_and_ctrl_c_comes_once():
    script = (
        "import os, signal, sys\n"
        "signal.signal(signal.SIGINT, lambda *_: os.write(1, b'INT'))\n"
        "print(os.isatty(0), os.tcgetpgrp(0) == os.getpgrp(), os.ttyname(0) == os.ttyname(1), flush=True)\n"
        "signal.pause(); print(input(), flush=True)"
    )
    pid, terminal = pty.fork()
    if pid == 0:
        os.execve(sys.executable, [sys.executable, "-m", "tactemu", *RUN, sys.executable, "-c", script], environment())

    def read(until: bytes) -> bytes:
        seen = b""
        while until not in seen:
            seen += os.read(terminal, 1024)
        return seen

    assert b"True True True" in read(b"\n")
    os.write(terminal, b"\x03")
    assert read(b"INT").count(b"INT") == 1
    os.write(terminal, b"words\n")
    rest = b""
    with contextlib.suppress(OSError):  # of Linux, at the end of a terminal
        while chunk := os.read(terminal, 1024):
            rest += chunk
    os.close(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
    assert b"words" in rest and b"INT" not in rest and b"Traceback" not in rest


def test_children_of_the_driver_are_in_the_view_too(compiled):
    done = tactemu(*RUN, "sh", "-c", f"(sh -c '{compiled('vendor')}')")
    assert done.returncode == 0 and done.stdout.startswith("opened 166\n"), done.stderr


def test_a_plain_user_gets_all_of_it(compiled, tmp_path_factory):
    if os.getuid():
        pytest.skip("this user is one: the other tests show it")
    python = shutil.which("python3", path="/usr/bin:/bin")
    if python is None:
        pytest.skip("no Python that another user may run")
    home = tmp_path_factory.mktemp("home")
    for folder in (home, *home.parents[:2]):
        folder.chmod(0o755)
    shutil.copy(compiled("vendor"), home / "vendor")
    os.chown(home, 1234, 1234)
    settings = {"HOME": str(home), "PYTHONPATH": os.pathsep.join(p for p in sys.path if p), "PATH": "/usr/bin:/bin"}
    probe = subprocess.run(
        [python, "-c", "import tactemu.serving"], env=settings, user=1234, group=1234, extra_groups=[], cwd=home,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if probe.returncode:
        pytest.skip(f"another user cannot import this package: {probe.stderr.strip().splitlines()[-1]}")
    done = subprocess.run(
        [python, "-m", "tactemu", *RUN, "sh", "-c", "id -u; ./vendor; grep CapEff /proc/self/status"],
        env=settings, user=1234, group=1234, extra_groups=[], cwd=home, capture_output=True, text=True, timeout=90,
        check=False,
    )  # fmt: skip
    lines = done.stdout.splitlines()
    assert done.returncode == 0, done.stderr
    assert lines[:2] == ["1234", "opened 166"] and lines[-2:] == ["8N 0", f"CapEff:\t{0:016x}"], (
        "itself, without powers"
    )


def test_programs_out_of_reach_are_named(compiled, tmp_path):
    static = compiled("hello", "-static")
    privileged = tmp_path / "privileged"
    shutil.copy(compiled("hello"), privileged)
    privileged.chmod(0o4755)
    script = tmp_path / "script"
    script.write_text(f"#!/usr/bin/env -S {static} -x\n")
    script.chmod(0o755)
    go = tmp_path / "go"
    go.write_bytes(renamed_section(compiled("hello"), b".comment\0", b".go.buildinfo\0"))
    go.chmod(0o755)
    for path, words in (
        (static, "statically linked"),
        (privileged, "set-uid"),
        (script, "statically linked"),
        (go, "Go"),
    ):
        assert words in reach.out_of_reach(str(path))
    assert not reach.out_of_reach(compiled("hello")) and not reach.out_of_reach(sys.executable)
    done = tactemu("exec", "flexitac", "--", static)
    assert done.stdout == "hello\n"
    assert "hello-static is statically linked: it finds the ports, reads and writes" in done.stderr


def renamed_section(program, old, new):
    """A program with a section of another name: the names' table is moved to the end, with the new one."""
    import struct

    data = bytearray(open(program, "rb").read())
    (sections,) = struct.unpack_from("<Q", data, 40)
    size, _, names = struct.unpack_from("<3H", data, 58)
    at = sections + names * size
    offset, length = struct.unpack_from("<2Q", data, at + 24)
    table = bytes(data[offset : offset + length])
    entry = next(
        where for where in range(sections, len(data) - 63, size)
        if table[struct.unpack_from("<I", data, where)[0] :].startswith(old)
    )  # fmt: skip
    struct.pack_into("<I", data, entry, len(table))
    struct.pack_into("<2Q", data, at + 24, len(data), len(table) + len(new))
    return bytes(data) + table + new


def test_without_library_and_compiler_it_says_what_still_works(tmp_path):
    settings = environment() | {"XDG_CACHE_HOME": str(tmp_path), "CC": "/no/such/compiler"}
    script = f"{sys.executable} -m serial.tools.list_ports -v"
    done = subprocess.run(
        [sys.executable, "-m", "tactemu", "exec", "flexitac", "--", "sh", "-c", script],
        env=settings, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0 and "VID:PID=0403:6001" in done.stdout
    assert "preload library cannot be made" in done.stderr and "reading and writing work" in done.stderr
