"""Environments of their own for drivers that need other versions of a library than the rest.

An environment is named after the hash of its requirements and kept below ``build/environments``, so that it is made
once. It has the driver and what that needs, nothing of ours: the driver finds us on the port alone.
"""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "build" / "environments"


def python_with(*requirements: str) -> str:
    """The interpreter of an environment with exactly these packages; skips where no index can be reached."""
    name = hashlib.sha256("\n".join((sys.version, *requirements)).encode()).hexdigest()[:16]
    folder = FOLDER / name
    python = folder / "bin" / "python"
    if not (folder / "made").exists():
        FOLDER.mkdir(parents=True, exist_ok=True)
        with open(FOLDER / f"{name}.lock", "w") as lock:
            import fcntl

            fcntl.flock(lock, fcntl.LOCK_EX)
            if not (folder / "made").exists():
                _make(folder, python, requirements)
    return str(python)


def _make(folder: Path, python: Path, requirements: tuple[str, ...]) -> None:
    subprocess.run([sys.executable, "-m", "venv", folder], check=True, capture_output=True)
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *requirements]
    done = subprocess.run(install, check=False, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": ""})
    if done.returncode:
        pytest.skip(f"{', '.join(requirements)} is not installed: {done.stderr.strip().splitlines()[-1][:200]}")
    (folder / "made").touch()
