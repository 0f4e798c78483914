"""Program that calls a Python reader in a loop and prints its readings, one JSON value a line.

Usage: ``python -m tactemu.judge.reader_loop package.module:function PORT``. The reader takes the port, or no argument
(the port is in ``TACTEMU_PORT``), and returns a reading: a table, a sequence, an array or a number; or it is a
generator of readings. An exception is printed and the reader is called again, as a user's program would do.
"""

from __future__ import annotations

import importlib
import inspect
import json
import os
import sys
import time
from collections.abc import Mapping
from typing import Any

PAUSE_S = 0.02
"""Pause after an exception [s]."""


def plain(value: Any) -> Any:
    """Return a reading as a value that JSON can hold."""
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if hasattr(value, "tolist"):  # of NumPy, torch ...
        return value.tolist()
    if isinstance(value, str | bytes | bool | int | float | None):
        return value if not isinstance(value, bytes) else None
    if hasattr(value, "_asdict"):
        return plain(value._asdict())
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if hasattr(value, "__dict__"):
        return {key: plain(each) for key, each in vars(value).items() if not key.startswith("_")}
    try:
        return [plain(each) for each in value]
    except TypeError:
        return str(value)


def found(name: str) -> Any:
    """Return the callable with a name.

    Raises:
        SystemExit: there is no such callable.
    """
    module, _, attribute = name.partition(":")
    sys.path.insert(0, os.getcwd())
    try:
        value = importlib.import_module(module)
        for part in attribute.split("."):
            value = getattr(value, part)
    except (ImportError, AttributeError) as error:
        sys.exit(f"--reads {name}: {error}; expected package.module:function")
    return value


def main() -> None:
    """Call the reader until the process is ended."""
    reader, port = found(sys.argv[1]), sys.argv[2]
    takes = [port] if inspect.signature(reader).parameters else []
    out, sys.stdout = sys.stdout, sys.stderr  # drivers print their own messages
    while True:
        try:
            reading = reader(*takes)
            for each in reading if inspect.isgenerator(reading) else [reading]:
                if each is not None:
                    out.write(json.dumps(plain(each)) + "\n")
                    out.flush()
        except Exception as error:
            sys.stderr.write(f"{type(error).__name__}: {error}\n")
            time.sleep(PAUSE_S)


if __name__ == "__main__":
    main()
