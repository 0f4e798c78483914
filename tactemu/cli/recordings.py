"""``tactemu record``, ``replay`` and ``faults``."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

from tactemu.cli.signals import ended_by_signals
from tactemu.wire.faults import DIRECTIONS, KINDS


def print_faults() -> None:
    """Print the kinds of fault with their effects, wires and options."""
    width, everywhere = max(map(len, KINDS)), set().union(*(kind.wires for kind in KINDS.values()))
    for name, kind in KINDS.items():
        values = {"by": " T", "as": " NAME", "hex=": "aa07"}
        options = "".join(f" [{option}{values.get(option, ' N')}]" for option in kind.options)
        on = "" if set(kind.wires) == everywhere else f" ({', '.join(kind.wires)} only)"
        print(f"  {name:{width}}  {kind.about}{on}{options}")
    print(f"\nKIND [N% | every N | frame N,N-N] [id=0x201] [prefix=55aa] [{' | '.join(DIRECTIONS)}]")
    print("     [at T [for T] | from T] [to T]")
    print("Times are 3s, 16ms or 200us of emulation time; N% is per frame, or the share of the bus (load, babble).")
    print("Frames are counted from 1, bytes from 0 or, negative, from the end, bits from the lowest, 0.")


def record_stream(source: str, file: Path, *, baud: int | None, seconds: float | None) -> None:
    """Record until Ctrl-C or for ``seconds``.

    Raises:
        TactemuError: the source or the file cannot be opened.
    """
    from tactemu.base.clock import RealClock
    from tactemu.emulator.replay import DEFAULT_BAUD, line_note, record
    from tactemu.truth.recorder import Recorder

    clock = RealClock()
    end_ns = None if seconds is None else round(seconds * 1e9)
    with ended_by_signals() as interrupted, Recorder(file, line=line_note(source, baud)) as recorder:
        print(f"recording {source} to {file}", flush=True)
        record(
            source,
            recorder,
            clock=clock,
            baud=baud or DEFAULT_BAUD,
            stop=lambda _: interrupted() or (end_ns is not None and clock.now_ns() >= end_ns),
        )
        count = recorder.count
    print(f"{count} entries in {clock.now_ns() / 1e9:.1f} s")


def replay_file(
    file: Path,
    port: str,
    *,
    skin: str | None,
    speed: float,
    step: bool,
    loop: bool,
    faults: tuple[str, ...],
    seconds: float | None,
    name: str | None = None,
) -> None:
    """Play a recording until its end, Ctrl-C, or for ``seconds``.

    Raises:
        TactemuError: the recording or the port cannot be opened.
    """
    from tactemu.base.clock import RealClock
    from tactemu.base.errors import TransportError
    from tactemu.control.replay_control import ReplayControl
    from tactemu.emulator.replay import Replay, connector_for
    from tactemu.session.session import control_socket
    from tactemu.transports import create
    from tactemu.truth.recording import load
    from tactemu.wire.line_models import line_model_for
    from tactemu.wire.wire import Wire

    recording = load(file, skin)
    transport = create(port)
    if transport.scheme not in ("memory", *line_model_for(connector_for(recording)).schemes):
        raise TransportError(f"{file} holds a {recording.kind} stream and cannot be played to {port}")
    wire = Wire(transport, connector_for(recording), pacing=False, faults=faults)
    player = Replay(recording, wire, clock=RealClock(), speed=speed, loop=loop)
    wire.open()
    try:
        poked = nullcontext() if step else control_socket(ReplayControl(player), str(file), name)
        with ended_by_signals(player.stop) as interrupted, poked:
            print(f"{len(player.entries)} frames ready on {wire.transport.address}", flush=True)
            _play_stepwise(player, interrupted) if step else player.run(seconds)
    finally:
        wire.close()
    counts = ", ".join(f"{name} {count}" for name, count in wire.counters.items())
    print(f"{player.position} of {len(player.entries)} frames played; {counts or 'nothing sent'}")


def _play_stepwise(player, interrupted: Callable[[], bool]) -> None:
    """Play a frame for every line on stdin."""
    for _ in sys.stdin:
        now = player.clock.now_ns()
        player.wire.receive(now)
        if interrupted() or (entry := player.send_next(now)) is None:
            break
        player.wire.flush(now)
        print(f"{entry.t_ns / 1e9:.6f} s  {entry.frame.hex() if isinstance(entry.frame, bytes) else entry.frame}")
