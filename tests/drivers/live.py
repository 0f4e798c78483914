"""A published driver at work beside the emulator, and which sample each of its readings is."""

from __future__ import annotations

import contextlib
import importlib.metadata
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tactemu
from tactemu.judge.driver import Driver
from tactemu.judge.trial_record import DriverRow
from tactemu.session.serving import Served
from tests.drivers.test_through_the_emulator import SCENE

SCRIPT = Path(__file__).parents[1] / "judge" / "published.py"
START_S = 30.0
"""For a driver to be imported, connect and read, on a busy machine."""
SETTLED = 10
"""Right readings in a row that say that a driver is well."""


def until(condition: Callable[[], bool], seconds: float, look_s: float = 0.02) -> bool:
    """Wait for something; whether it came."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(look_s)
    return True


@contextlib.contextmanager
def served(folder: Path, device: str, *, rate_hz: float = 100, noise: float = 0.1, more: str = "") -> Iterator[Served]:
    """A device on a port; every taxel carries noise, so that each reading names its sample."""
    path = folder / "scene.toml"
    path.write_text(SCENE.format(device=device, rate_hz=rate_hz, noise=noise, device_options="") + more)
    with tactemu.serve(path) as dev:
        yield dev


class Live:
    """A driver of ``tests/judge/published.py`` in a process of its own; use it in a ``with`` statement.

    Args:
        name: of the driver, which is its distribution's; the test is skipped where it is not installed.
        port: what it opens.
        dev: whose samples it reads.
        of: what a perfect driver reports for a sample's counts, shape ``(n,)``.
        baud: if it is not the driver's own choice.
    """

    def __init__(
        self, name: str, port: str, dev: Served | None = None, of: Callable[[np.ndarray], Any] = np.ravel,
        baud: int | None = None,
    ):  # fmt: skip
        try:
            importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            pytest.skip(f"{name} is not installed")
        command = [sys.executable, "-u", str(SCRIPT), name, port, *([str(baud)] if baud else [])]
        self.dev, self._of = dev, of
        self.driver = Driver(command, {name: port})
        self._times: list[int] = []
        self._known: dict[tuple[float, ...], int] = {}

    def __enter__(self) -> Live:
        return self

    def __exit__(self, *_) -> None:
        self.driver.end()

    @property
    def rows(self) -> list[DriverRow]:
        """What it has handed out so far."""
        return list(self.driver.rows)

    @property
    def notes(self) -> list[str]:
        """What it has said beside, so far."""
        return [note.text for note in list(self.driver.notes)]

    def place(self, said: DriverRow) -> int | None:
        """When the sample was taken that a reading equals, number for number [ns, emulation time]."""
        key = tuple(value for name, value in said.row.items() if name not in ("n", "valid"))
        if key not in self._known:
            self._catch_up()
        return self._known.get(key)

    def _catch_up(self) -> None:
        assert self.dev is not None
        last = self._times[-1] if self._times else -1
        for sample in [sample for sample in list(self.dev.truth.samples) if sample.t_ns > last]:
            self._times.append(sample.t_ns)
            self._known[tuple(np.asarray(self._of(sample.counts), float).tolist())] = sample.t_ns

    def settles(self, seconds: float = START_S) -> bool:
        """Ten right readings in a row, of samples from now on."""
        assert self.dev is not None
        now = self.dev.emulator.clock.now_ns()

        def settled() -> bool:
            last = [self.place(said) for said in self.rows[-SETTLED:]]
            return len(last) == SETTLED and all(place is not None and place >= now for place in last)

        return until(settled, seconds)

    def story(self, since: int) -> dict[str, int]:
        """What became of readings after so many, without what did not: wrong, marked, older, again, lost."""
        rows = self.rows
        before = next((place for said in rows[since - 1 :: -1] if (place := self.place(said)) is not None), None)
        seen, last = {before} - {None}, before
        story = dict.fromkeys(("wrong", "marked", "older", "again"), 0)
        for said in rows[since:]:
            place = self.place(said)
            if not said.row.get("valid", 1):
                story["marked"] += 1
            elif place is None:
                story["wrong"] += 1
            else:
                story["older"] += last is not None and place < last
                story["again"] += place == last
                last = place
                seen.add(place)
        story["lost"] = sum(min(seen) <= t <= max(seen) for t in self._times) - len(seen) if seen else 0
        return {name: count for name, count in story.items() if count}
