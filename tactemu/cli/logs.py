"""Commands for truth logs and recordings: summarise, convert, draw, record and replay them."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactemu.base.errors import TactemuError, TransportError
from tactemu.base.formats import CAN_FRAMES, CONVERTIBLE, LOGS, READABLE, names
from tactemu.base.statistics import counter_words
from tactemu.cli.parameters import Faults, RunName, Seconds
from tactemu.cli.sections import in_sections

if TYPE_CHECKING:
    from tactemu.emulator.replay import Replay

commands = typer.Typer(rich_markup_mode=None)
_CAN = [each for each in CONVERTIBLE if each.holds == CAN_FRAMES]
_OTHERS = [each for each in CONVERTIBLE if each not in (*LOGS, *_CAN)]


@commands.command()
def truth(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The truth log that `tactemu run --truth FILE` wrote.")],
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    to: Annotated[
        str | None,
        typer.Option(
            "--to",
            metavar="FORMAT",
            help=f"Convert the log to {names(_OTHERS)}; its CAN frames to {names(_CAN)}; or to another truth log, "
            f"{names(LOGS)}. Give a format, or a file name that ends in one.",
        ),
    ] = None,
    export: Annotated[Path | None, typer.Option(metavar="FILE", hidden=True, help="The same as --to FILE.")] = None,
    skin: Annotated[str | None, typer.Option(metavar="NAME", help="Convert this skin only.")] = None,
    sense: Annotated[str | None, typer.Option(metavar="NAME", help="Convert this sense of it only.")] = None,
) -> None:
    """Summarise a truth log, or convert it for other tools.

    \b
      tactemu run anyskin --seconds 10 --fault 'flip 5%' --truth truth.mcap
      tactemu truth truth.mcap
      tactemu truth truth.mcap --to foxglove.mcap
      tactemu truth truth.mcap --to thumb.csv --skin thumb
      tactemu truth truth.mcap --to bus.log

    The summary counts samples, frames, drops and injected faults of each device. --to writes a file beside the log, or
    the file that you name.
    """
    if to is None and export is None:
        from tactemu.cli.truths import print_summary

        print_summary(file, json=json)
        return
    from tactemu.cli.progress import show_count
    from tactemu.truth.conversion import convert

    count, files = convert(file, to or str(export), skin=skin, sense=sense, watch=show_count)
    typer.echo(f"{count} rows written to {', '.join(map(str, files))}")


@commands.command("plot")
def plot_log(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The truth log to draw.")],
    to: Annotated[
        Path | None,
        typer.Option(
            "--to", metavar="FILE", help="The picture to write: .png, .svg or .html; default: beside the log."
        ),
    ] = None,
    skin: Annotated[str | None, typer.Option(metavar="NAME", help="The skin to draw; default: the first.")] = None,
    sense: Annotated[str | None, typer.Option(metavar="NAME", help="The sense to draw; default: the first.")] = None,
) -> None:
    """Draw a truth log.

    The pictures show curves, contact patch, hysteresis, delay to the wire and the spectrum of the error.

    \b
      tactemu run anyskin --seconds 10 --truth truth.mcap
      tactemu plot truth.mcap
      tactemu plot truth.mcap --to thumb.png --skin thumb
    """
    try:
        from tactemu.view.conversions.plots import plot
    except ModuleNotFoundError as error:
        raise TactemuError(f"plot needs the package {error.name}: pip install 'tactemu[plots]'") from None

    picture = to or file.with_suffix(".html")
    plot(file, picture, skin=skin, sense=sense)
    typer.echo(f"drawn to {picture}")


@commands.command("record")
def record_stream(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help=f"The recording to write: {names(LOGS, dot='.')}; for CAN also {names(_CAN, dot='.')}.",
        ),
    ],
    source: Annotated[
        str,
        typer.Option(
            "--from", metavar="SOURCE", help="The sensor: /dev/ttyUSB0, a pyserial URL, or can:INTERFACE:CHANNEL."
        ),
    ],
    baud: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Baud rate of a serial port; default: 115200.")
    ] = None,
    seconds: Seconds = None,
) -> None:
    """Record the bytes or frames of a real sensor, until Ctrl-C.

    The recording keeps the time of each; `tactemu replay` plays it to a driver.

    \b
      tactemu record anyskin.mcap --from /dev/ttyACM0
      tactemu record hand.log --from can:socketcan:can0 --seconds 10
    """
    from tactemu.base.clock import RealClock
    from tactemu.cli.signals import ended_by_signals
    from tactemu.emulator.replay import DEFAULT_BAUD, line_note, record
    from tactemu.truth.recorder import Recorder

    clock = RealClock()
    end_ns = None if seconds is None else round(seconds * 1e9)
    with ended_by_signals() as interrupted, Recorder(file, line=line_note(source, baud)) as recorder:
        typer.echo(f"recording {source} to {file}")
        record(
            source, recorder, clock=clock, baud=baud or DEFAULT_BAUD,
            stop=lambda _: interrupted() or (end_ns is not None and clock.now_ns() >= end_ns),
        )  # fmt: skip
        count = recorder.count
    typer.echo(f"{count} entries in {clock.now_ns() / 1e9:.1f} s")


@commands.command(
    cls=in_sections({
        "Port and faults": "port skin fault",
        "Time": "speed step loop seconds",
    })
)  # fmt: skip
def replay(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help=f"The recording or truth log to play: {names(READABLE, dot='.')}.")
    ],
    port: Annotated[
        str,
        typer.Option(
            "--port", metavar="PORT", help="The port for the driver: pty:PATH, can:INTERFACE:CHANNEL, tcp:HOST:PORT ..."
        ),
    ],
    skin: Annotated[
        str | None, typer.Option(metavar="NAME", help="The skin to play, if a truth log has several.")
    ] = None,
    speed: Annotated[
        float, typer.Option(metavar="X", help="Speed: 2 is twice as fast, inf as fast as possible.")
    ] = 1.0,
    step: Annotated[bool, typer.Option("--step", help="Send one frame for every line on stdin.")] = False,
    loop: Annotated[bool, typer.Option("--loop", help="Start again at the end.")] = False,
    fault: Faults = None,
    seconds: Seconds = None,
    name: RunName = None,
) -> None:
    """Play a recording to a driver.

    A serial recording starts when the driver opens the port.

    \b
      tactemu replay anyskin.mcap --port pty:/tmp/skin --speed 2
      tactemu replay hand.blf --port can:socketcan:vcan0 --fault 'drop 1%'
      tactemu replay truth.mcap --port pty:/tmp/skin --skin thumb --step
    """
    from tactemu.base.clock import RealClock
    from tactemu.cli.signals import ended_by_signals
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
    wire = Wire(transport, connector_for(recording), pacing=False, faults=fault or ())
    player = Replay(recording, wire, clock=RealClock(), speed=speed, loop=loop)
    wire.open()
    try:
        poked = nullcontext() if step else control_socket(ReplayControl(player), str(file), name)
        with ended_by_signals(player.stop) as interrupted, poked:
            typer.echo(f"{len(player.entries)} frames ready on {wire.transport.address}")
            _play_stepwise(player, interrupted) if step else player.run(seconds)
    finally:
        wire.close()
    counts = ", ".join(f"{counter_words(name)} {count}" for name, count in wire.counters.items())
    typer.echo(f"{player.position} of {len(player.entries)} frames played; {counts or 'nothing sent'}")


def _play_stepwise(player: Replay, interrupted: Callable[[], bool]) -> None:
    """Play a frame for every line on stdin."""
    for _ in sys.stdin:
        now = player.clock.now_ns()
        player.wire.receive(now)
        if interrupted() or (entry := player.send_next(now)) is None:
            break
        player.wire.flush(now)
        print(f"{entry.t_ns / 1e9:.6f} s  {entry.frame.hex() if isinstance(entry.frame, bytes) else entry.frame}")
