"""A run as it goes on, in Rerun's viewer: a process beside the emulator, so that no viewer delays a frame.

The run writes a second truth log, to a pipe; this process reads it, as it would read a file, and sends it on::

    python -m tactemu.view.conversions.live PIPE [URL]
"""

from __future__ import annotations

import contextlib
import errno
import importlib.util
import os
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from tactemu.base.errors import TactemuError
from tactemu.truth import packed
from tactemu.truth.entries import End, Header
from tactemu.truth.truth import Truth
from tactemu.view.conversions.converting import EXTRA

_START_S, _END_S = 60.0, 60.0
"""How long the process may take to start, and to send what is left."""


@contextlib.contextmanager
def shown(truth: Truth, url: str | None = None) -> Iterator[None]:
    """Have a run shown while it lasts; close the truth before the end.

    Args:
        truth: of the run, which has not begun.
        url: of a viewer that listens (``rerun+http://127.0.0.1:9876/proxy``); ``None``: start one.

    Raises:
        TactemuError: Rerun is not installed, or cannot be started.
    """
    if importlib.util.find_spec("rerun") is None:
        raise TactemuError(f"--rerun needs the package rerun-sdk: {EXTRA}")
    with tempfile.TemporaryDirectory(prefix="tactemu-") as folder:
        pipe = Path(folder) / "run.mcap"
        os.mkfifo(pipe, 0o600)
        command = [sys.executable, "-m", "tactemu.view.conversions.live", str(pipe), *([url] if url else [])]
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)
        try:
            held = _reached(pipe, process)
            try:
                truth.write_also(pipe, flush_s=0.1)
            finally:
                os.close(held)
            yield
        finally:
            truth.close()
            try:
                process.wait(_END_S)
            except (subprocess.TimeoutExpired, KeyboardInterrupt):
                process.kill()
                process.wait()


def _reached(pipe: Path, process: subprocess.Popen) -> int:
    """The pipe opened, once the process has opened its end: who opens this one before would wait for ever."""
    end = time.monotonic() + _START_S
    while process.poll() is None and time.monotonic() < end:
        try:
            return os.open(pipe, os.O_WRONLY | os.O_NONBLOCK)
        except OSError as error:
            if error.errno != errno.ENXIO:
                raise
        time.sleep(0.01)
    raise TactemuError("--rerun: the process that sends to the viewer did not start")


def main() -> int:
    """Send on what comes through the pipe, until it ends."""
    pipe, url = Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else None
    content = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)  # from here on the emulator may write
    os.set_blocking(content, True)
    from tactemu.view.conversions.rerun import RerunFile

    viewer = RerunFile(None)
    viewer.connect(url)
    begun = select.poll()
    begun.register(content, select.POLLIN)
    if not begun.poll(_START_S * 1e3):  # a pipe that nobody has opened yet for writing is at its end
        return 1
    try:
        for record in packed.read(os.fdopen(content, "rb")):
            if isinstance(record, Header):
                viewer.begin(record)
            elif not isinstance(record, End):
                viewer.add(record)
                if viewer.due():
                    viewer.flush()
    finally:
        viewer.finish()
    return 0


if __name__ == "__main__":
    sys.exit(main())
