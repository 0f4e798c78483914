"""A folder for this process of tests, and the processes it starts, with its usual ports and control sockets.

In the folder for temporary files they would meet those of a suite that runs at the same time. The path is short, as
that of a socket must be. pytest's own folders stay where they were.
"""

import atexit
import os
import shutil
import tempfile
from pathlib import Path

os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", tempfile.gettempdir())
RUN_FOLDER = Path(tempfile.mkdtemp(prefix="tt-", dir=os.environ["PYTEST_DEBUG_TEMPROOT"]))
RUN_FOLDER.chmod(0o1777)
os.environ["TMPDIR"] = os.environ["XDG_RUNTIME_DIR"] = tempfile.tempdir = str(RUN_FOLDER)


@atexit.register
def _remove(owner: int = os.getpid()) -> None:
    """Remove the folder, after all that was imported later has cleaned up in it."""
    if os.getpid() == owner:
        shutil.rmtree(RUN_FOLDER, ignore_errors=True)
