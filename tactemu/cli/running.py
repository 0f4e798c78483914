"""``tactemu run``: build an emulator, open its ports, run it, and print a summary."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from tactemu.base.errors import SceneError, StateError, TransportError, nearest
from tactemu.base.files import check_writable
from tactemu.base.gc_tuning import no_full_collections
from tactemu.base.kernels import start_quietly
from tactemu.base.statistics import Lateness
from tactemu.cli.datasheet import options_of
from tactemu.cli.reports import Say, advice, report_if_slow, say_json, say_text, unreached_hint
from tactemu.cli.signals import ended_by_signals
from tactemu.control.state import statistics_of
from tactemu.emulator.channel import Channel
from tactemu.emulator.emulator import Emulator
from tactemu.truth import Truth

if TYPE_CHECKING:
    from tactemu.control.server import CommandTarget, Server
    from tactemu.view.page.opening import PageListener

_OWNER = re.compile(r"[^:=]+=")
"""The name of a skin or a connector in front of a port."""
REPORT_PERIOD_NS = 1_000_000_000
"""The time between two log lines of a run."""
MANY_BODIES = 1000
"""Number of bodies from which on the build of a scene may be slow."""
INCOMPLETE = 4
"""The exit code of a run with an incomplete truth log or saved state."""


def run_target(
    target: str,
    *,
    options: Sequence[str] = (),
    ports: Sequence[str],
    rates: Sequence[str],
    seed: int | None,
    seconds: float | None,
    compute: str | None,
    faults: tuple[str, ...],
    truth: Path | None,
    keep: str | None,
    style: str,
    clock: str = "real",
    preempt: bool = False,
    name: str | None = None,
    adjustable: tuple[str, ...] = (),
    again: Path | None = None,
    rerun: str | bool = False,
    web: Web | None = None,
    restore: Path | None = None,
    save: Path | None = None,
    save_at: float | None = None,
    measured: bool = False,
) -> None:
    """Run a device or a scene.

    ``style`` is auto, plain or json; ``rerun`` is True, or the address of a viewer; ``web`` is the address of the page.

    Raises:
        TactemuError: the request cannot be met; nothing is left behind.
    """
    from tactemu.base.clock import LockstepClock, RealClock, VirtualClock
    from tactemu.control.command_replay import replay_commands
    from tactemu.control.control import Control
    from tactemu.emulator.assembly import RunOptions, assemble, truth_of
    from tactemu.scene.file import load
    from tactemu.scene.steering import steered

    clocks = {"real": RealClock, "virtual": VirtualClock, "lockstep": LockstepClock}
    if clock not in clocks:
        raise SceneError(f"--clock {clock}: expected {', '.join(clocks)}{nearest(clock, clocks)}")
    if clock == "virtual" and seconds is None:
        raise SceneError("--clock virtual runs as fast as possible and would never end; add --seconds")
    if save_at is not None and save is None:
        raise SceneError("--save-at needs the file: add --save FILE")
    if save is not None:
        check_writable(save, "the state")
    page = None if web is None else _page_listener(web)
    if preempt:
        from tactemu.base.priority import enable_realtime_priority

        if clock != "real":
            raise SceneError(f"--preempt is for --clock real only; --clock {clock} is never late")
        enable_realtime_priority()
    run_options = RunOptions(
        port=ports_of(ports), rate_hz=rate_of(rates), faults=faults, seed=seed, compute=compute, adjustable=adjustable,
        measured=measured,
    )  # fmt: skip
    loaded = steered(load(target, options_of(options)))
    n_bodies = len(loaded.tables.body)
    start_quietly()
    log = truth_of(loaded, truth, keep)
    try:
        with report_if_slow(f"building {n_bodies:,} bodies") if n_bodies >= MANY_BODIES else nullcontext():
            control = Control(assemble(loaded, run_options, clock=clocks[clock](), truth=log))
        if restore is not None:
            control.emulator.restore(restore)
        if again is not None:
            replay_commands(control, again)
        if save is not None and save_at is not None:
            control.emulator.call(partial(control.emulator.save, save), round(save_at * 1e9))
        at_end = save if save_at is None else None
        with _rerun_viewer(log, rerun) if rerun else nullcontext():
            listen = partial(control_socket, control, name, target, yield_to_loop=clock == "real")
            if page is not None:
                listen = partial(_with_page, listen, page)
            run_emulator(control.emulator, seconds=seconds, style=style, listen=listen, save=at_end)
    finally:
        log.close()
        if page is not None:
            page.listener.close()


@dataclass(frozen=True)
class Web:
    """The address of the page; None: the default."""

    host: str | None = None
    port: int | None = None


def _page_listener(web: Web) -> PageListener:
    from tactemu.view.page.opening import open_listener, warning

    if text := warning(web.host):
        print(f"tactemu: {text}", file=sys.stderr)
    return open_listener(web.host, web.port)


@contextmanager
def _with_page(listen: Callable[[], AbstractContextManager[Server | None]], page: PageListener) -> Iterator[None]:
    """Serve the control socket and the web page."""
    from tactemu.view.page.opening import page_process

    link = page.url
    with listen() as server:
        if server is None:
            raise TransportError("--web: the page needs the control socket, which could not be opened")
        with page_process(page, server.endpoint.name) as over:
            print(f"see {link}", file=sys.stderr, flush=True)
            try:
                yield
            finally:
                over.set()
                server.close()  # the page takes this as the end of the run


def _rerun_viewer(log: Truth, where: str | bool) -> AbstractContextManager[None]:
    from tactemu.view.conversions.live import rerun_viewer

    return rerun_viewer(log, where if isinstance(where, str) else None)


def control_socket(
    driven: CommandTarget, name: str | None, target: str, *, yield_to_loop: bool = True
) -> AbstractContextManager[Server | None]:
    """Serve commands under a name, default the target's; without a ``name``, a failure is only printed.

    Raises:
        TactemuError: the socket of the given name cannot be opened.
    """
    from tactemu.control.endpoints import Endpoint
    from tactemu.control.server import Server

    place = Endpoint(name or Path(target.rpartition(":")[2]).stem, target, exactly=name is not None)
    try:
        return closing(Server(place, driven, yield_to_loop=yield_to_loop))
    except TransportError as error:
        if name is not None:
            raise
        print(f"tactemu: `tactemu poke` will not find this run: {error}", file=sys.stderr)
        return nullcontext()


def rate_of(words: Sequence[str]) -> float | dict[str, float] | None:
    """Return ``["200"]`` as a number, ``["touch=200", "imu=1000"]`` as a dictionary by stream.

    Raises:
        SceneError: a word is no rate, or one of several has no stream.
    """
    rates: dict[str, float] = {}
    for word in words:
        stream, _, hz = word.rpartition("=")
        try:
            rates[stream] = float(hz)
        except ValueError:
            raise SceneError(f"--rate {word}: expected HZ, or STREAM=HZ") from None
    if len(words) > 1 and "" in rates:
        raise SceneError(f"--rate: with several rates, name the stream of each: --rate STREAM={rates['']:g}")
    return rates.get("", rates or None)


def ports_of(words: Sequence[str]) -> str | dict[str, str] | None:
    """Return ``["pty:/tmp/skin"]`` as one port, ``["thumb=pty:/tmp/a", "palm=pty:/tmp/b"]`` by skin or connector.

    Raises:
        TransportError: one of several ports has no skin, or a skin has two.
    """
    if len(words) == 1 and not _OWNER.match(words[0]):
        return words[0]
    ports = {}
    for word in words:
        owner, given, port = word.partition("=")
        if not given or not _OWNER.match(word):
            raise TransportError(f"--port {word}: with several ports, name the skin of each: --port SKIN={word}")
        if owner in ports:
            raise TransportError(f"--port {word}: {owner!r} has a port already, {ports[owner]}")
        ports[owner] = port
    return ports or None


def run_emulator(
    emulator: Emulator,
    *,
    seconds: float | None,
    style: str,
    listen: Callable[[], AbstractContextManager] = nullcontext,
    save: Path | None = None,
) -> None:
    """Run an assembled emulator with a picture, log lines or JSON lines, until it is told to stop."""
    console = Console(highlight=False)
    live = style == "auto" and console.is_terminal and not console.is_dumb_terminal
    say = say_json if style == "json" else say_text(console)
    view = _live_view(emulator, console) if live else nullcontext()
    _warm_up(console)
    with ended_by_signals(emulator.stop), no_full_collections(), listen(), emulator:
        for channel in emulator.channels:
            say(
                "ready", skin=channel.name, device=channel.device.name, port=_addresses(channel),
                **_rates(channel),
            )  # fmt: skip
        if not live and not emulator.clock.virtual:
            _report_regularly(emulator, say)
        with view:
            emulator.run(seconds)
        save_failed = save is not None and _save_failed(emulator, save)
        summaries = emulator.summary()
    for entry in summaries:
        say("summary", **entry)
    for channel in emulator.channels:
        if text := advice(emulator, channel):
            say("advice", skin=channel.name, text=text)
        if text := unreached_hint(channel):
            say("advice", skin=channel.name, text=text)
    if lost := emulator.truth.lost:
        say("advice", skin="truth log", text=f"{lost} entries are missing: the disk was full, or too slow")
    if lost or save_failed:
        raise SystemExit(INCOMPLETE)


def _save_failed(emulator: Emulator, save: Path) -> bool:
    """Save the state at the end of a run; after an error, print it and return True."""
    try:
        emulator.save(save)
    except StateError as error:
        print(f"tactemu: {error}", file=sys.stderr)
        return True
    return False


def _addresses(channel: Channel) -> str | dict[str, str]:
    addresses = {port: wire.transport.address for port, wire in channel.wires.items()}
    return addresses if len(addresses) > 1 else next(iter(addresses.values()))


def _rates(channel: Channel) -> dict[str, object]:
    """Return the sampling rates in force, and those of the firmware."""
    own = {stream: 1e9 / period if period else 0.0 for stream, period in channel.device.periods.items()}
    rates = {"rate_hz": channel.rates_hz(), "firmware_rate_hz": own}
    rounded = {what: {stream: round(hz, 3) for stream, hz in each.items()} for what, each in rates.items()}
    return {what: each.get("", each) if len(each) == 1 else each for what, each in rounded.items()}


def _warm_up(console: Console) -> None:
    """Print and compute a percentile once before a port opens, because the first time is slow."""
    with console.capture():
        console.print("")
    lateness = Lateness(keep=1)
    lateness.add(0)
    lateness.percentile_ns(50)


def _report_regularly(emulator: Emulator, say: Say) -> None:
    def report() -> None:
        now = emulator.clock.now_ns()
        for channel in emulator.channels:
            say("running", t_s=round(now / 1e9, 3), **statistics_of(emulator, channel))
        emulator.call(report, now + REPORT_PERIOD_NS)

    emulator.call(report, emulator.clock.now_ns() + REPORT_PERIOD_NS)


def _live_view(emulator: Emulator, console: Console):
    from tactemu.session.live_view import LiveView

    view = LiveView(emulator, console)
    view.rehearse()
    return view
