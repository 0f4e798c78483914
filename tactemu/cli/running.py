"""``tactemu run``: build, open, say where, run, sum up."""

from __future__ import annotations

import json
import signal
import sys
import time
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from rich.console import Console

from tactemu.cli.kernels import start_quietly
from tactemu.emulator import Emulator
from tactemu.errors import SceneError, TactemuError

REPORT_PERIOD_NS = 1_000_000_000


def run_target(
    target: str,
    *,
    port: str | None,
    rate_hz: float | None,
    seed: int | None,
    seconds: float | None,
    compute: str | None,
    faults: tuple[str, ...],
    truth: Path | None,
    style: str,
    virtual: bool,
) -> None:
    """Run a device or a scene; ``style`` is auto, plain or json.

    Raises:
        TactemuError: the request cannot be met; nothing is left behind.
    """
    from tactemu.assembly import Wishes, assemble
    from tactemu.clock import RealClock, VirtualClock
    from tactemu.scene.file import load

    if virtual and seconds is None:
        raise SceneError("--virtual runs as fast as it can and would never end; say how long with --seconds")
    if rate_hz is not None and not 0 < rate_hz <= 1e6:
        raise SceneError(f"--rate: expected a rate in Hz, more than 0 and at most 1e6, got {rate_hz}")
    wishes = Wishes(port=port, rate_hz=rate_hz, faults=faults, seed=seed, compute=compute)
    loaded = load(target)
    start_quietly()
    log = _truth(truth)
    try:
        emulator = assemble(loaded, wishes, truth=log).emulator
        emulator.clock = VirtualClock() if virtual else RealClock()
        run_emulator(emulator, seconds=seconds, style=style)
    finally:
        log.close()


def run_emulator(emulator: Emulator, *, seconds: float | None, style: str) -> None:
    """Run an assembled emulator with a picture, log lines or JSON lines, until it is told to stop."""
    console = Console(highlight=False)
    live = style == "auto" and console.is_terminal
    say = _say_json if style == "json" else _say_plain(console)
    with _stopped_by_signals(emulator), emulator:
        for channel in emulator.channels:
            say(
                "ready", skin=channel.name, device=channel.device.name, port=channel.wire.transport.address,
                rate_hz=round(1e9 / channel.device.period_ns, 3),
            )  # fmt: skip
        if not live and not emulator.clock.virtual:
            _report_regularly(emulator, say)
        with _view(emulator, console) if live else nullcontext():
            emulator.run(seconds)
        summaries = [summary(emulator, channel) for channel in emulator.channels]
    for entry in summaries:
        say("summary", **entry)


def summary(emulator: Emulator, channel: Any) -> dict[str, Any]:
    """What one device did: statistics, what became of its frames and of the driver's, and what was injected."""
    entry: dict[str, Any] = {"skin": channel.name, **channel.statistics.as_dict(), **dict(channel.wire.counters)}
    if channel.device.counters:
        entry["device"] = dict(channel.device.counters)
    if emulator.truth.injected:
        entry["injected"] = dict(emulator.truth.injected)
    return entry


def _report_regularly(emulator: Emulator, say) -> None:
    def report() -> None:
        now = emulator.clock.now_ns()
        for channel in emulator.channels:
            say("running", t_s=round(now / 1e9, 3), **summary(emulator, channel))
        emulator.at(now + REPORT_PERIOD_NS, report)

    emulator.at(emulator.clock.now_ns() + REPORT_PERIOD_NS, report)


def _say_json(event: str, **entry: Any) -> None:
    print(json.dumps({"event": event, **entry}), flush=True)


def _say_plain(console: Console):
    def say(event: str, **entry: Any) -> None:
        skin = entry.pop("skin")
        if event == "ready":
            what = f"{entry['device']} ready on {entry['port']} at {entry['rate_hz']:g} Hz"
            console.print(what if skin == entry["device"] else f"{skin}: {what}", soft_wrap=True, markup=False)
        else:
            clock = time.strftime("%H:%M:%S") if event == "running" else "summary"
            console.print(f"{clock} {skin}: {_words(entry)}", soft_wrap=True, markup=False)
        sys.stdout.flush()

    return say


def _words(entry: dict[str, Any]) -> str:
    parts = []
    for name, value in entry.items():
        if isinstance(value, dict):
            parts.append(f"{name} " + " ".join(f"{key}={count}" for key, count in value.items()))
        else:
            parts.append(f"{name.replace('_', ' ')} {value:g}" if isinstance(value, float) else f"{name} {value}")
    return ", ".join(parts)


def _view(emulator: Emulator, console: Console):
    from tactemu.view import LiveView

    return LiveView(emulator, console)


def _truth(path: Path | None):
    from tactemu.truth import Truth

    try:
        return Truth(path)
    except OSError as error:
        raise TactemuError(f"--truth {path}: cannot write the truth log: {error.strerror}") from None


@contextmanager
def _stopped_by_signals(emulator: Emulator):
    """Ctrl-C and SIGTERM end the run after the current turn; a second one ends the process."""

    def stop(number, _frame):
        emulator.stop()
        signal.signal(number, signal.SIG_DFL)

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
