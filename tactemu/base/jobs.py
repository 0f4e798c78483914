"""Long plans of many jobs: a journal of what is finished, and the workers of a cluster."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from tactemu.base.errors import TactemuError
from tactemu.base.files import check_overwriting

RETRIES = 3
"""Number of retries of a job whose worker is lost."""
_CONNECT_TIMEOUT_S = 10
Key = TypeVar("Key")
Result = TypeVar("Result")


class Journal:
    """The results of finished jobs by key, one JSON line for each, so that an interrupted plan loses nothing.

    Args:
        path: the file; a missing one is made with the first result.
        field: the name of the result in a line.
        digest: the digest of everything that results depend on beside their keys; lines with another one are ignored.
    """

    def __init__(self, path: Path, field: str, digest: str | None = None):
        self._path, self._field = path, field
        self._head = {} if digest is None else {"digest": digest}
        self.results: dict[str, Any] = {}
        check_overwriting(path, '"key":')
        written = path.read_text(encoding="utf-8") if path.exists() else ""
        self._is_cut = bool(written) and not written.endswith("\n")
        for line in written.splitlines():
            try:
                entry = json.loads(line)
            except ValueError:  # a line cut off by an interruption
                continue
            if entry.get("digest") == digest:
                self.results[entry["key"]] = entry[field]

    def add(self, key: str, result: Any) -> None:
        """Add the result of a finished job, which JSON can hold."""
        self.results[key] = result
        with self._path.open("a", encoding="utf-8") as file:
            line = json.dumps({**self._head, "key": key, self._field: result})
            file.write("\n" * self._is_cut + line + "\n")
        self._is_cut = False


def run_on_cluster(
    jobs: Mapping[Key, Callable[[], Result]], address: str
) -> Iterator[tuple[Key, Callable[[], Result]]]:
    """Run jobs on the workers of a Dask scheduler, and yield the key of each as it finishes, with a callable that
    returns its result or raises its error.

    Raises:
        TactemuError: Dask is missing, or the scheduler cannot be reached.
    """
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise TactemuError("a cluster needs Dask: pip install 'tactemu[cluster]'") from None
    try:
        client = Client(address, timeout=_CONNECT_TIMEOUT_S)
    except (OSError, TimeoutError, ValueError) as error:
        raise TactemuError(f"--cluster {address}: no scheduler answers: {error}") from None
    with client:
        futures = {client.submit(job, pure=False, retries=RETRIES): key for key, job in jobs.items()}
        for future in as_completed(futures):
            yield futures[future], future.result
