"""``tactemu exec``: exit status, signals, streams and terminal of the driver are those of the command."""

import contextlib
import os
import pty
import select
import shutil
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest

import tactemu
from tactemu.base.errors import TransportError
from tactemu.cli import executing
from tactemu.exec import reach
from tactemu.exec.keeping import Keeper
from tactemu.truth import read_log
from tests.cli.command import environment, here, start
from tests.cli.command import tactemu as tactemu_command

RUN = ("exec", "-q", "flexitac", "--")


def test_what_cannot_be_done_is_said_before_anything_is_built(tmp_path):
    script = tmp_path / "plain.txt"
    script.write_text("no program")
    for status, words, text in (
        (125, ("exec", "flexitac"), "after --"),
        (125, ("exec", "flexitak", "--", "true"), "did you mean 'flexitac'?"),
        (
            125,
            ("exec", "flexitac", "--node", "COM3", "--", "true"),
            "expected ttyUSB0, ttyACM0, can0, or a UART: ttyS, ttyAMA",
        ),
        (126, ("exec", "flexitac", "--", str(script)), "not executable"),
        (127, ("exec", "flexitac", "--", "no-such-program"), "not found"),
    ):
        done = here(*words)
        assert (done.returncode, done.stdout) == (status, "") and text in done.stderr


def test_streams_status_and_preloaded_libraries_pass_through_and_children_are_in_the_view(compiled):
    script = f"cat; echo said >&2; echo $LD_PRELOAD; (sh -c '{compiled('vendor')}'); exit 7"
    done = subprocess.run(
        [sys.executable, "-m", "tactemu", *RUN, "sh", "-c", script], input="heard\n", capture_output=True, text=True,
        env=environment() | {"LD_PRELOAD": "libdl.so.2"}, timeout=60, check=False,
    )  # fmt: skip
    heard, preload, opened, *_ = done.stdout.splitlines()
    assert (done.returncode, heard, opened, done.stderr) == (7, "heard", "opened 166", "said\n")
    assert preload.endswith("/preload.so:libdl.so.2")


def test_a_signal_goes_to_the_driver_and_its_end_is_ours():
    script = (
        "import os, signal, sys, time\n"
        "signal.signal(signal.SIGHUP, signal.SIG_DFL)\n"  # who runs the tests may have it ignored, as nohup does
        "signal.signal(signal.SIGTERM, lambda *_: print('TERM', flush=True))\n"
        "print('up', flush=True); signal.pause(); signal.pause()"
    )
    with start(*RUN, sys.executable, "-c", script) as run:
        assert run.stdout and run.stderr and run.stdout.readline() == "up\n"
        run.send_signal(signal.SIGTERM)
        assert run.stdout.readline() == "TERM\n", "it may go on"
        run.send_signal(signal.SIGHUP)
        begin = time.monotonic()
        while "/dev/ptmx" in open_files(run.pid):
            assert time.monotonic() - begin < 10, "the emulator has its port still"
            time.sleep(0.01)
        assert run.wait(10) == 128 + signal.SIGHUP


@pytest.mark.parametrize("ignored", [False, True])
def test_a_hang_up_ends_a_start_unless_it_is_to_be_ignored(ignored):
    handler = signal.SIG_IGN if ignored else signal.SIG_DFL
    with start(*RUN, "true", preexec_fn=lambda: signal.signal(signal.SIGHUP, handler)) as run:
        while not takes_signals(run.pid):
            assert run.poll() is None
        run.send_signal(signal.SIGHUP)
        assert run.wait(30) == (0 if ignored else 128 + signal.SIGHUP)
        told = f"tactemu: ended by SIGHUP from process {os.getpid()} before it had started\n"
        assert run.stderr and run.stderr.read() == ("" if ignored else told)


def test_a_user_is_told_which_signal_has_ended_the_driver():
    with start(*RUN, "sh", "-c", "echo up; exec sleep 60") as run:
        assert run.stdout and run.stdout.readline() == "up\n"
        run.send_signal(signal.SIGTERM)
        assert run.wait(10) == 128 + signal.SIGTERM
        assert (
            run.stderr and run.stderr.read() == f"tactemu: SIGTERM from process {os.getpid()} has ended the program\n"
        )


def test_a_start_that_fails_leaves_no_traceback_of_the_keeper(capfd):
    keeper = Keeper()
    select.select([keeper._wire], [], [])  # it has said that it is ready, and is not read
    keeper.close()
    assert capfd.readouterr() == ("", "")


def takes_signals(pid):
    """Whether a thread takes the signals of a process, whose main thread has blocked these and no others."""
    blocked = next(line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("SigBlk"))
    mask = int(blocked.split()[1], 16)
    return bool(mask >> signal.SIGHUP - 1 & 1) and not mask >> signal.SIGWINCH - 1 & 1


def open_files(pid):
    found = set()
    with contextlib.suppress(OSError):  # the process has gone
        for path in Path(f"/proc/{pid}/fd").iterdir():
            with contextlib.suppress(OSError):
                found.add(os.readlink(path))
    return found


def test_the_drivers_terminal_is_ours_and_ctrl_c_comes_once():
    script = (
        "import os, signal, sys\n"
        "signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})\n"  # else it can come just before a read that waits
        "print(os.isatty(0), os.tcgetpgrp(0) == os.getpgrp(), os.ttyname(0) == os.ttyname(1), flush=True)\n"
        "signal.sigwait({signal.SIGINT})\n"
        "os.write(1, b'INT')\n"
        "print(input(), *(each.name for each in signal.sigpending()), flush=True)"
    )
    pid, terminal = pty.fork()
    if pid == 0:
        os.execve(sys.executable, [sys.executable, "-m", "tactemu", *RUN, sys.executable, "-c", script], environment())

    def read(until: bytes) -> bytes:
        seen = b""
        while until not in seen:
            seen += os.read(terminal, 1024)
        return seen

    read(b"True True True")
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


ASK = """
import socket, sys
kind, host, port = sys.argv[1].partition(":")[0], *sys.argv[1].rpartition("/")[2].rsplit(":", 1)
with socket.socket(type=socket.SOCK_DGRAM if kind == "udp" else socket.SOCK_STREAM) as wire:
    wire.settimeout(20)
    wire.connect((host, int(port)))
    wire.sendall(bytes.fromhex(sys.argv[2]))
    print(wire.recv(100)[:12].hex())
"""
UPGRADE = (
    b"GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


@pytest.mark.parametrize(
    ("words", "place", "asked", "answer"),
    [
        (("xela_server",), "ws://127.0.0.1:5000", UPGRADE.hex(), b"HTTP/1.1 101".hex()),
        (("ati_net_ft",), "udp://127.0.0.1:49152", "1234 0002 00000001", "00000001"),
        (
            ("inspire_rh56dftp", "--port", "tcp:6000"), "127.0.0.1:6000",
            "0007 0000 0006 ff 03 03e8 0001", "0007 0000 0005 ff 03 02",
        ),
    ],
)  # fmt: skip
def test_a_device_on_the_network_is_at_its_usual_port_and_it_is_said(words, place, asked, answer):
    done = tactemu_command("exec", *words, "--", sys.executable, "-c", ASK, place, asked)
    assert done.returncode == 0 and done.stdout.startswith(answer.replace(" ", "")), done
    assert "no driver connected" not in done.stderr
    assert done.stderr.startswith("tactemu: ") and f" is {'socket://' * place[0].isdigit()}{place}\n" in done.stderr


def test_a_driver_that_looks_elsewhere_for_a_device_on_the_network_is_told_where_it_is():
    done = tactemu_command("exec", "xela_server", "--port", "ws:0", "--", "true")
    first, last = done.stderr.splitlines()
    place = first.rpartition("/")[2]
    assert last.startswith(
        f"tactemu: xela_server: no driver connected to ws://{place}; a driver that connects to another address"
    )
    assert last.endswith(f"needs --port ws:0.0.0.0:{place.rpartition(':')[2]}")


ASK_WRONGLY = """
import serial, time
with serial.Serial("/dev/ttyUSB0", 921600) as port:
    port.write(b"?!")
    time.sleep(0.5)
"""


def test_what_a_device_did_not_understand_is_said_and_stands_in_the_log(tmp_path):
    log = tmp_path / "truth.mcap"
    run = ("exec", "dynpick", "--truth", str(log), "--", sys.executable, "-c")
    done = tactemu_command(*run, ASK_WRONGLY)
    assert done.stderr.splitlines()[1:] == [
        "tactemu: dynpick did not understand all that it was sent: unknown command 2"
    ]
    assert read_log(log).summary["dynpick"]["device"] == {"requests": 2, "unknown_command": 2}
    done = tactemu_command(*run, ASK_WRONGLY.replace("?!", "R"))
    assert done.stderr.splitlines()[1:] == []
    assert read_log(log).summary["dynpick"]["device"] == {"requests": 1}


def test_a_device_on_the_network_beside_a_bus_is_refused():
    bus, server = tactemu.serve("linker_hand_l6"), tactemu.serve("xela_server")
    with pytest.raises(TransportError, match=r"xela_server is at ws://.* --expose tcp:\d+"):
        tactemu.exec_environment(bus, server, way="preload").start()
    done = here("exec", "flexitac", "--port", "pty:/tmp/x", "--", "true")
    assert done.returncode == 125 and "--node" in done.stderr


AGAIN = """
import fcntl, os, termios, time
port = os.open("/dev/ttyUSB0", os.O_RDWR | os.O_NOCTTY)
fcntl.ioctl(port, termios.TIOCEXCL)
os.close(port)
for _ in range(100):
    try:
        os.open("/dev/ttyUSB0", os.O_RDWR | os.O_NOCTTY)
        break
    except OSError:
        time.sleep(0.05)
print("again")
"""
PLAIN = """
import subprocess, sys
from tactemu.exec.build import library
from tactemu.exec.keeping import Keeper
from tactemu.exec.port import Node, UsbPort

usb = {"vid": 0x0403, "pid": 0x6001, "manufacturer": "", "product": "", "serial": "7", "interface": 0, "node": "ttyUSB"}
keeper = Keeper(str(library()))
port = UsbPort(Node(keeper.ask, usb, number=None, hub_port=1))
port.open()
words = ["sh", "-c", "id -u; ./vendor; readlink /dev/serial/by-id/*; grep CapEff /proc/self/status; "
         "python3 again.py; ls /dev/ttyUSB* /run/udev/data/c136:*"]
with subprocess.Popen(keeper.enter(words)) as driver:
    while driver.poll() is None:
        port.poll()
port.close()
keeper.close()
"""


def test_a_plain_user_gets_all_of_it(compiled, tmp_path_factory):
    if os.getuid():
        pytest.skip("this user is one: the other tests show it")
    python = shutil.which("python3", path="/usr/bin:/bin")
    if python is None:
        pytest.skip("no Python that another user may run")
    home = tmp_path_factory.mktemp("home")
    for folder in (home, *(each for each in home.parents if each.name.startswith(("pytest-", "popen-")))):
        folder.chmod(0o755)
    shutil.copy(compiled("vendor"), home / "vendor")
    (home / "again.py").write_text(AGAIN)
    os.chown(home, 1234, 1234)
    done = subprocess.run(
        [python, "-c", PLAIN], cwd=home, user=1234, group=1234, extra_groups=[], capture_output=True, text=True,
        env={"HOME": str(home), "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "PATH": "/usr/bin:/bin"},
        timeout=60, check=False,
    )  # fmt: skip
    if "ImportError" in done.stderr or "ModuleNotFoundError" in done.stderr:
        pytest.skip(f"{python} cannot import what we need: {done.stderr.strip().splitlines()[-1]}")
    lines = done.stdout.splitlines()
    assert lines[:2] == ["1234", "opened 166"], done.stderr
    assert lines[-6:-2] == ["8N 0", "../../ttyUSB0", f"CapEff:\t{0:016x}", "again"], "itself, without powers"
    assert lines[-2] == "/dev/ttyUSB0" and lines[-1].startswith("/run/udev/data/c136:"), "one terminal, the second"


FORBIDDEN = """
from tactemu.base.errors import TransportUnavailable
from tactemu.exec.keeping import Keeper
try:
    Keeper().wait()
except TransportUnavailable as error:
    print(error)
"""


def test_where_no_namespaces_are_allowed_it_says_why_and_what_helps():
    """As where the administrator has switched them off: here in a namespace that allows no further one."""
    shell = (
        "echo 0 > /proc/sys/user/max_user_namespaces; exec setpriv --bounding-set=-sys_admin --inh-caps=-sys_admin "
        f'{sys.executable} -c "$0"'
    )
    done = subprocess.run(
        ["unshare", "-Ur", "sh", "-c", shell, FORBIDDEN], env=environment(), capture_output=True, text=True, timeout=30,
        check=False,
    )  # fmt: skip
    if not shutil.which("setpriv") or "unshare" in done.stderr:
        pytest.skip(f"needs setpriv and unshare of util-linux: {done.stderr}")
    assert "`sudo sysctl -w user.max_user_namespaces=15000`" in done.stdout, done.stderr


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
    done = tactemu_command("exec", "flexitac", "--", static)
    assert done.stdout == "hello\n"
    assert "hello-static is statically linked: it finds the ports, reads and writes" in done.stderr


def renamed_section(program, old, new):
    """A program with a section of another name: the table of names is moved to the end, with the new one."""
    data = bytearray(Path(program).read_bytes())
    (sections,) = struct.unpack_from("<Q", data, 40)
    size, _, names = struct.unpack_from("<3H", data, 58)
    at = sections + names * size
    offset, length = struct.unpack_from("<2Q", data, at + 24)
    table = bytes(data[offset : offset + length])
    headers = range(sections, len(data) - size + 1, size)
    entry = next(where for where in headers if table[struct.unpack_from("<I", data, where)[0] :].startswith(old))
    struct.pack_into("<I", data, entry, len(table))
    struct.pack_into("<2Q", data, at + 24, len(data), len(table) + len(new))
    return bytes(data) + table + new


def test_without_library_and_compiler_names_and_bytes_still_work(monkeypatch, capsys, tmp_path, exec_environment):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("CC", "/no/such/compiler")
    env = exec_environment("flexitac")
    executing._announce(env, "true")
    said = capsys.readouterr().err
    assert "preload library cannot be made" in said and "there are no modem lines" in said
    script = (
        "import serial; from serial.tools import list_ports\n"
        "(found,) = list_ports.comports()\n"
        "print(found.hwid, len(serial.Serial(found.device, 2_000_000, timeout=5).read(64)))"
    )
    done = env.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=30)
    assert "VID:PID=0403:6001" in done.stdout and done.stdout.endswith(" 64\n"), done.stderr
