"""A live view of a run in Rerun: a process beside the emulator, so that no viewer delays a frame.

The run writes a second truth log to a pipe; this process reads it like a file and sends it to Rerun's viewer::

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
from tactemu.base.formats import FORMATS
from tactemu.truth import mcap_format
from tactemu.truth.entries import End, Header
from tactemu.truth.truth import Truth

_START_TIMEOUT_S = 60.0
"""The time that the process may take to start."""
_END_TIMEOUT_S = 60.0
"""The time that the process may take to send the remaining entries; then it is killed."""


@contextlib.contextmanager
def rerun_viewer(truth: Truth, url: str | None = None) -> Iterator[None]:
    """Show a run in Rerun's viewer; at the end, close the truth log.

    Args:
        truth: the truth log of the run, which has not begun.
        url: the address of a viewer that listens (``rerun+http://127.0.0.1:9876/proxy``); None: start one.

    Raises:
        TactemuError: Rerun is not installed, or cannot be started.
    """
    if importlib.util.find_spec("rerun") is None:
        raise TactemuError(f"--rerun needs the package rerun-sdk: {FORMATS['rrd'].install}")
    with tempfile.TemporaryDirectory(prefix="tactemu-") as folder:
        pipe = Path(folder) / "run.mcap"
        os.mkfifo(pipe, 0o600)
        command = [sys.executable, "-m", "tactemu.view.conversions.live", str(pipe), *([url] if url else [])]
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)
        try:
            held = _open_pipe(pipe, process)
            try:
                truth.write_also(pipe, flush_s=0.1)
            finally:
                os.close(held)
            yield
        finally:
            truth.close()
            try:
                process.wait(_END_TIMEOUT_S)
            except (subprocess.TimeoutExpired, KeyboardInterrupt):
                process.kill()
                process.wait()


def _open_pipe(pipe: Path, process: subprocess.Popen) -> int:
    """Open the pipe for writing once the process has opened its end; a blocking open before that could hang forever.

    Raises:
        TactemuError: the process has ended, or did not open its end in time.
    """
    end = time.monotonic() + _START_TIMEOUT_S
    while process.poll() is None and time.monotonic() < end:
        try:
            return os.open(pipe, os.O_WRONLY | os.O_NONBLOCK)
        except OSError as error:
            if error.errno != errno.ENXIO:
                raise
        time.sleep(0.01)
    raise TactemuError("--rerun: the process that sends to the viewer did not start")


def main() -> int:
    """Send the log from the pipe to the viewer until it ends; return the exit status."""
    pipe, url = Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else None
    content = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)  # from here on the emulator may write
    os.set_blocking(content, True)
    from tactemu.view.conversions.rerun import RerunFile

    viewer = RerunFile(None)
    viewer.connect(url)
    begun = select.poll()
    begun.register(content, select.POLLIN)
    if not begun.poll(_START_TIMEOUT_S * 1e3):  # a read before a writer has opened the pipe would return its end
        return 1
    try:
        for record in mcap_format.read_open(os.fdopen(content, "rb")):
            if isinstance(record, Header):
                viewer.begin(record)
            elif not isinstance(record, End):
                viewer.add(record)
                if viewer.is_due():
                    viewer.flush()
    finally:
        viewer.finish(End())
    return 0


if __name__ == "__main__":
    sys.exit(main())
