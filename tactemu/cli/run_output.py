"""The output of ``tactemu run``: a picture, log lines or JSON lines while it runs, and a summary."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from functools import partial
from typing import TYPE_CHECKING

from tactemu.base.errors import StateError, TransportError
from tactemu.base.gc_tuning import enable_collections
from tactemu.base.statistics import Lateness
from tactemu.cli.fitting import print_error
from tactemu.cli.reports import Say, advice, report_if_slow, say_json, say_text, unreached_hint
from tactemu.cli.signals import ended_by_signals
from tactemu.control.state import statistics_of
from tactemu.emulator.channel import Channel
from tactemu.emulator.emulator import Emulator
from tactemu.session.session import Session

if TYPE_CHECKING:
    from tactemu.control.server import Server
    from tactemu.session.live_view import LiveView
    from tactemu.view.page.opening import PageListener

REPORT_PERIOD_NS = 1_000_000_000
"""The time between two log lines of a run."""
MANY_BODIES = 1000
"""Number of bodies from which on the build of a scene may be slow."""
FIRST_START = "the first start of a scene compiles its kernels, which takes some seconds"
INCOMPLETE = 4
"""The exit code of a run with an incomplete truth log or saved state."""


def run_session(session: Session, *, style: str, viewer: str | bool = False, page: PageListener | None = None) -> None:
    """Run a device or a scene with a picture, log lines or JSON lines, until it is told to stop.

    ``style`` is auto, plain, json, or quiet, which prints nothing.
    ``viewer`` is True, or the address of a Rerun viewer.

    Raises:
        TactemuError: the request cannot be met; nothing is left behind.
    """
    try:
        n_bodies = len(session.load().tables.body)
        with report_if_slow(f"building {n_bodies:,} bodies" if n_bodies >= MANY_BODIES else FIRST_START):
            session.build()
        if page is not None:
            session.beside = partial(_page_beside, page, style != "quiet")
        with closing(session), _rerun_viewer(session, viewer) if viewer else nullcontext():
            _run(session, style)
    finally:
        if page is not None:
            page.listener.close()


@contextmanager
def _page_beside(page: PageListener, says_link: bool, server: Server | None) -> Iterator[None]:
    """Serve the web page of a control socket, and print its link to stderr if ``says_link``."""
    from tactemu.view.page.opening import page_process

    if server is None:
        raise TransportError("--web: the page needs the control socket, which could not be opened")
    url = page.url  # page_process closes the socket here
    with page_process(page, server.endpoint.name) as over:
        if says_link:
            print(f"see {server.endpoint.name}: {url}", file=sys.stderr, flush=True)
        try:
            yield
        finally:
            over.set()
            server.close()  # the page takes this as the end of the run


def _rerun_viewer(session: Session, where: str | bool) -> AbstractContextManager[None]:
    from tactemu.view.conversions.live import rerun_viewer

    return rerun_viewer(session.emulator.truth, where if isinstance(where, str) else None)


def _run(session: Session, style: str) -> None:
    emulator = session.emulator
    say, view = _output(emulator, style)
    lateness = Lateness(keep=1)  # computed once before a port opens, because the first time is slow
    lateness.add(0)
    lateness.percentile_ns(50)
    enable_collections()
    with ended_by_signals(emulator.stop), closing(session.open()):
        for channel in emulator.channels:
            say(
                "ready", skin=channel.name, device=channel.device.name, port=_addresses(channel),
                **_rates(channel),
            )  # fmt: skip
        if view is None and not emulator.clock.virtual:
            _report_regularly(emulator, say)
        with view or nullcontext():
            session.run()
        save_failed = _save_failed(session)
        summaries = emulator.summary()
    for entry in summaries:
        say("summary", **entry)
    for channel in emulator.channels:
        for text in filter(None, (advice(emulator, channel), unreached_hint(channel))):
            say("advice", skin=channel.name, text=text)
    if lost := emulator.truth.lost:
        say("advice", skin="truth log", text=f"{lost} entries are missing: the disk was full, or too slow")
    if lost or save_failed:
        raise SystemExit(INCOMPLETE)


def _say_nothing(event: str, **entry: object) -> None:
    """Print no report."""


def _output(emulator: Emulator, style: str) -> tuple[Say, LiveView | None]:
    """Return what prints events, and the picture of a run on a terminal."""
    if style in ("json", "quiet"):
        return say_json if style == "json" else _say_nothing, None
    from rich.console import Console  # 25 ms of the start

    console = Console(highlight=False)
    with console.capture():
        console.print("")  # once before a port opens, because the first time is slow
    if style != "auto" or not console.is_terminal or console.is_dumb_terminal:
        return say_text(console), None
    from tactemu.session.live_view import LiveView

    view = LiveView(emulator, console)
    view.rehearse()
    return say_text(console), view


def _save_failed(session: Session) -> bool:
    """Save the state at the end of a run if it is wanted; after an error, print it and return True."""
    try:
        session.save()
    except StateError as error:
        print_error(f"tactemu: {error}")
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


def _report_regularly(emulator: Emulator, say: Say) -> None:
    def report() -> None:
        now = emulator.clock.now_ns()
        for channel in emulator.channels:
            say("running", t_s=round(now / 1e9, 3), **statistics_of(emulator, channel))
        emulator.call(report, now + REPORT_PERIOD_NS)

    emulator.call(report, emulator.clock.now_ns() + REPORT_PERIOD_NS)
