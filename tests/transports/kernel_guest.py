"""Running a program of the tests in ``scripts/kernel-guest``, and what it says: a JSON object a line."""

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]


def said_by(module: str, *arguments: object, modules: str, seconds: int) -> Iterator[dict[str, Any]]:
    """Yield what a module of the tests says in a guest with these modules of the kernel, as soon as it says it.

    Skips the test where no guest can be had; fails it if the module fails.
    """
    program = [sys.executable, "-m", module, *map(str, arguments)]
    guest = subprocess.Popen(
        [ROOT / "scripts/kernel-guest", "-m", "1G", "-t", str(seconds), "-M", modules, "--", *program],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT,
    )  # fmt: skip
    assert guest.stdout is not None and guest.stderr is not None
    errors: list[str] = []
    reader = threading.Thread(target=lambda: errors.append(guest.stderr.read()))
    reader.start()
    other = []
    try:
        for line in guest.stdout:
            if line.startswith("{"):
                yield json.loads(line)
            else:
                other.append(line)
    except BaseException:
        guest.terminate()
        raise
    finally:
        status = guest.wait()
        reader.join()
    if status == 125:
        pytest.skip(errors[0].strip().splitlines()[-1])
    assert status == 0, errors[0][-3000:] + "".join(other)[-3000:]
