"""Environments of their own, for drivers and libraries that need other versions of a library, or that are heavy.

``environments/NAME.txt`` is a lock: every package with its version, ``package==version``, what they need included, for
nothing else is installed. The environment is kept below ``build/environments`` under the hash of lock and Python, so
that it is made once and never changed. It has nothing of ours: the driver finds us on the port alone.
"""

import fcntl
import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

LOCKS = Path(__file__).with_suffix("")
FOLDER = Path(__file__).parents[2] / "build" / "environments"


def locked(name: str) -> dict[str, str]:
    """The packages of an environment, and their versions.

    Raises:
        ValueError: a line is no ``package==version``.
    """
    lines = [line.partition("#")[0].strip() for line in (LOCKS / f"{name}.txt").read_text().splitlines()]
    packages = dict(line.split("==", 1) if "==" in line else (line, "") for line in lines if line)
    if loose := [package for package, version in packages.items() if not version or not version[0].isdigit()]:
        raise ValueError(f"{name}.txt: pin {', '.join(loose)} as package==version")
    return packages


def python_with(name: str) -> str:
    """The interpreter of the environment ``name``, made if need be; skips where no index can be reached."""
    requirements = [f"{package}=={version}" for package, version in locked(name).items()]
    digest = hashlib.sha256("\n".join((sys.version, *requirements)).encode()).hexdigest()[:16]
    folder = FOLDER / f"{name}-{digest}"
    FOLDER.mkdir(parents=True, exist_ok=True)
    with open(FOLDER / f"{folder.name}.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "made").exists():
            _make(folder, requirements)
    return str(folder / "bin" / "python")


def _make(folder: Path, requirements: list[str]) -> None:
    subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True, capture_output=True)
    pip = [folder / "bin" / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps"]
    done = subprocess.run(
        [*pip, *requirements], check=False, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": ""}
    )
    if done.returncode:
        pytest.skip(f"{', '.join(requirements)} is not installed: {done.stderr.strip().splitlines()[-1][:200]}")
    (folder / "made").touch()
