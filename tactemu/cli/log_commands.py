"""Commands for truth logs and recordings: summarise, convert, draw, record and replay them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactemu.base.formats import CAN_FRAMES, CONVERTIBLE, LOGS, READABLE, names
from tactemu.cli.parameters import Faults, RunName, Seconds

commands = typer.Typer(rich_markup_mode=None)
_CAN = [each for each in CONVERTIBLE if each.holds == CAN_FRAMES]
_OTHERS = [each for each in CONVERTIBLE if each not in (*LOGS, *_CAN)]


@commands.command()
def truth(
    file: Annotated[Path, typer.Argument(help="The truth log that `tactemu run --truth FILE` wrote.")],
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
    from tactemu.cli.truths import convert_log, print_summary

    if to is None and export is None:
        print_summary(file, json=json)
    else:
        convert_log(file, to or str(export), skin=skin, sense=sense)


@commands.command()
def plot(
    file: Annotated[Path, typer.Argument(help="The truth log to draw.")],
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
      tactemu run anyskin --clock virtual --port memory: --seconds 10 --truth truth.mcap
      tactemu plot truth.mcap
      tactemu plot truth.mcap --to thumb.png --skin thumb
    """
    from tactemu.cli.truths import plot_log

    plot_log(file, to or file.with_suffix(".html"), skin=skin, sense=sense)


@commands.command()
def record(
    file: Annotated[
        Path,
        typer.Argument(help=f"The recording to write: {names(LOGS, dot='.')}; for CAN also {names(_CAN, dot='.')}."),
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
    from tactemu.cli.recordings import record_stream

    record_stream(source, file, baud=baud, seconds=seconds)


@commands.command()
def replay(
    file: Annotated[Path, typer.Argument(help=f"The recording or truth log to play: {names(READABLE, dot='.')}.")],
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
    from tactemu.cli.recordings import replay_file

    replay_file(
        file, port, skin=skin, speed=speed, step=step, loop=loop, faults=tuple(fault or ()), seconds=seconds,
        name=name,
    )  # fmt: skip
