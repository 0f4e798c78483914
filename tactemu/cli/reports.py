"""The output of ``tactemu run``: events as JSON or text, and advice if samples are missed."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from statistics import median
from typing import TYPE_CHECKING, Any

from tactemu.base.statistics import counter_words
from tactemu.emulator.channel import Channel
from tactemu.emulator.emulator import Emulator
from tactemu.emulator.lifecycle import Simulated

if TYPE_CHECKING:
    from rich.console import Console

Say = Callable[..., None]
"""A callable that prints an event: ``say(event, skin=..., **entry)``."""

MISSED_SHARE = 0.01
"""Share of samples that a device may miss before the report gives advice."""
BUSY_SHARE = 0.5
"""Share of the time between samples above which the simulation is named as the reason."""

SLOW_START_S = 2.0
"""Processor time after which a slow task is reported; wall time would depend on other processes."""


@contextmanager
def report_if_slow(text: str) -> Iterator[None]:
    """Write one line to stderr if what runs inside takes more than :data:`SLOW_START_S`."""
    done, begun_s = threading.Event(), time.process_time()

    def watch() -> None:
        while not done.wait(0.1):
            if time.process_time() - begun_s > SLOW_START_S:
                print(f"tactemu: {text}", file=sys.stderr, flush=True)
                return

    thread = threading.Thread(target=watch, name="told if long", daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def say_json(event: str, **entry: Any) -> None:
    """Print an event as a line of JSON."""
    print(json.dumps({"event": event, **entry}), flush=True)


def say_text(console: Console) -> Say:
    """Return a callable that prints an event as a line of text."""

    def say(event: str, **entry: Any) -> None:
        skin = entry.pop("skin")
        if event == "ready":
            what = f"{entry['device']} ready on {_listed(entry['port'])} at {_listed(entry['rate_hz'])} Hz"
            if entry["firmware_rate_hz"] != entry["rate_hz"]:
                what += f" (its firmware: {_listed(entry['firmware_rate_hz'])} Hz)"
            line = what if skin == entry["device"] else f"{skin}: {what}"
        elif event == "advice":
            line = f"{skin}: {entry['text']}"
        else:
            line = f"{time.strftime('%H:%M:%S') if event == 'running' else event} {skin}: {sentence(entry)}"
        console.print(line, soft_wrap=not console.file.isatty(), markup=False)
        sys.stdout.flush()

    return say


def _listed(value: Any) -> str:
    """Return a number or a name as text, or those of several ports or streams."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {_listed(each)}" for name, each in value.items())
    return f"{value:g}" if isinstance(value, float) else str(value)


def sentence(entry: dict[str, Any]) -> str:
    """Return ``300 samples at 100 Hz, late p50/p99/max 40/90/210 us; wire: sent 299``."""
    lateness = "/".join(f"{entry[f'lateness_{which}_us']:.0f}" for which in ("p50", "p99", "max"))
    text = f"{entry['samples']} samples at {entry['rate_hz']:.1f} Hz, late p50/p99/max {lateness} us"
    odd = [f"{entry[name]} {name}" for name in ("missed", "stretched") if entry[name]]
    late = [f"{entry['missed'] + entry['stretched']} not in time: {', '.join(odd)}"] if odd else []
    late += [f"{entry['silent']} silent"] if entry["silent"] else []
    text += f" ({'; '.join(late)})" if late else ""
    for group in ("wire", "device", "injected"):
        counts = [f"{counter_words(name)} {count}" for name, count in entry[group].items() if count]
        text += f"; {group}: {', '.join(counts)}" if counts else ""
    return text


HARMLESS = ("requests", "unplugged")
"""The counters of a device that do not count errors."""
_OF_THE_WIRE = ("misheard", "overrun", "overflow", "collision")
_LOOPBACK = ("127.0.0.1", "::1", "localhost")


def not_understood(entry: Mapping[str, Any]) -> str:
    """Return the counters of input that a device did not understand, as ``unknown command 3, refused 1``; or ``""``."""
    counts = {name: count for name, count in entry["device"].items() if name not in HARMLESS}
    counts |= {name: entry["wire"][name] for name in _OF_THE_WIRE if name in entry["wire"]}
    return ", ".join(f"{counter_words(name)} {count}" for name, count in counts.items() if count)


def unreached_hint(channel: Channel) -> str:
    """Return the hint for a network device on loopback that no driver has reached, or ``""``."""
    for wire in channel.wires.values():
        port, host = wire.transport, getattr(wire.transport, "host", "")
        if host in _LOOPBACK and not (wire.was_opened or wire.counters["received"]):
            return (
                f"no driver connected to {port.address}; a driver that connects to another address of this machine, or "
                f"from another machine, needs --port {port.scheme}:0.0.0.0:{getattr(port, 'port', 0)}"
            )
    return ""


def advice(emulator: Emulator, channel: Channel) -> str:
    """Return what to change if a device misses samples, or ``""``."""
    statistics = channel.statistics
    late = statistics.missed + statistics.stretched
    if late <= MISSED_SHARE * max(statistics.samples, 1):
        return ""
    found = f"{late} of {statistics.samples + statistics.missed} samples were not taken in time: "
    period_us = min(p for p in (channel.period_ns(s) for s in channel.timers) if p) / 1e3
    simulation = emulator.simulation
    if simulation is None or simulation.plan is None:
        return f"{found}nothing is simulated, so the machine is too busy or the rate too high"
    simulated_us = _step_us(simulation) * period_us * 1e3 / simulation.dt_ns
    if simulated_us < BUSY_SHARE * period_us:
        return (
            f"{found}not for the simulation, which takes {simulated_us:.0f} of the {period_us:.0f} us between them; "
            "the machine is too busy, or the rate too high for it"
        )
    simulation.plan.time_stages(time.perf_counter_ns)
    stage = max(simulation.plan.stages, key=lambda stage: stage.cost_us or 0.0)
    dial = f" ({stage.cheaper})" if stage.cheaper else ""
    return (
        f"{found}the simulation takes {simulated_us:.0f} of the {period_us:.0f} us between them, most of it in "
        f"{stage.name!r}{dial}. Raise [scene] dt, choose a cheaper model, lower --rate, or let "
        "`tactemu tune` choose"
    )


def _step_us(simulation: Simulated, repeats: int = 50) -> float:
    """Return the median time of a step [us]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter_ns()
        simulation.advance_to(simulation.time_ns + simulation.dt_ns)
        times.append(time.perf_counter_ns() - start)
    return median(times) / 1e3
