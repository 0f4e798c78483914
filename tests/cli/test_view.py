"""The live view, on a terminal of its own."""

import os
import pty
import re
import select
import signal
import sys
import time

from tests.cli.command import environment


def watch(seconds: float, *arguments: str, until: str = "", term: str = "xterm-256color") -> tuple[int, str]:
    """Run on a terminal, press Ctrl-C once ``until`` is shown, after ``seconds`` at most; exit status and everything
    that was shown."""
    child, terminal = pty.fork()
    if child == 0:
        os.execve(
            sys.executable, [sys.executable, "-m", "tactemu", "run", *arguments],
            environment() | {"TERM": term, "COLUMNS": "160", "LINES": "40"},
        )  # fmt: skip
    shown, ends, pressed = b"", time.monotonic() + 60, False
    while time.monotonic() < ends:
        readable, _, _ = select.select([terminal], [], [], 0.1)
        try:
            shown += os.read(terminal, 65536) if readable else b""
        except OSError:  # the terminal is closed: the program has ended
            break
        if not pressed and b"ready" in shown:
            ends, pressed = time.monotonic() + seconds + 20, time.monotonic() + seconds
        if pressed and (time.monotonic() > pressed or (until and until.encode() in shown and pressed < float("inf"))):
            os.write(terminal, b"\x03")
            pressed = float("inf")
    else:
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    os.close(terminal)
    return os.waitstatus_to_exitcode(status), re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown.decode())


def test_the_view_shows_the_press_and_ends_cleanly(tmp_path):
    port = tmp_path / "skin"
    code, shown = watch(20.0, "anyskin", "--port", f"pty:{port}", until="██")
    assert code == 0
    assert f"anyskin ready on {port}" in shown
    assert "██" in shown, "the press"
    assert re.search(r"rate \d+\.\d Hz", shown)
    assert f"waiting for a driver to open {port}" in shown.replace("\n", "")
    assert "Ctrl-C ends" in shown
    assert "summary anyskin: " in shown
    assert not os.path.lexists(port)


def test_a_terminal_that_cannot_draw_gets_log_lines(tmp_path):
    code, shown = watch(2.5, "anyskin", "--port", f"pty:{tmp_path / 'skin'}", term="dumb")
    assert code == 0 and "summary anyskin: " in shown
    assert re.search(r"\d\d:\d\d:\d\d anyskin: \d+ samples at \d+", shown)
