"""``tactemu compare``: a real sensor beside its model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactemu.cli.parameters import Options, quantity_of
from tactemu.cli.sections import in_sections

if TYPE_CHECKING:
    from rich.console import Console

    from tactemu.judge.compare.report import CompareReport

commands = typer.Typer(rich_markup_mode=None)

DIFFERS, NOTHING_COMPARED, INTERRUPTED = 1, 3, 130
"""The exit codes if the protocol differs, if nothing could be compared, and after Ctrl-C."""
MAX_PRINTED = 40
"""Largest number of lines of each kind that are printed; the report has all."""


@commands.command(
    cls=in_sections({
        "Sensor": "source port baud",
        "Requests and presses": "listen ask_all press press_seconds presses",
        "Time and reports": "seconds out",
    })
)  # fmt: skip
def compare(
    device: Annotated[
        str, typer.Argument(metavar="DEVICE", help="A name of `tactemu devices`, or path/to/device.py:Class.")
    ],
    source: Annotated[
        str,
        typer.Option(
            "--from",
            metavar="SOURCE",
            help="The sensor: /dev/ttyUSB0, a pyserial URL, can:INTERFACE:CHANNEL, tcp:HOST:PORT, udp:HOST:PORT; "
            "or a capture of it.",
        ),
    ],
    options: Options = None,
    listen: Annotated[bool, typer.Option("--listen", help="Send nothing.")] = False,
    ask_all: Annotated[
        bool,
        typer.Option("--ask-all", help="Send all documented requests, also those that write, move, zero or reset."),
    ] = False,
    press: Annotated[
        bool, typer.Option("--press", help="Have you press taxels one after the other, to check their order.")
    ] = False,
    press_seconds: Annotated[
        float, typer.Option(metavar="S", parser=quantity_of("--press-seconds", low=0.2), help="Time for each press.")
    ] = 3.0,
    presses: Annotated[
        Path | None,
        typer.Option("--presses", metavar="FILE", help="The presses in a capture: a CSV of taxel,begin_s,end_s."),
    ] = None,
    seconds: Annotated[
        float, typer.Option("--seconds", metavar="S", parser=quantity_of("--seconds", low=0.5), help="Time to listen.")
    ] = 10.0,
    port: Annotated[str, typer.Option("--port", metavar="NAME", help="The device's port, if it has several.")] = "",
    baud: Annotated[int | None, typer.Option(metavar="N", min=1, help="Baud rate; default: the model's.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FOLDER", help="Folder for reports and capture; default: a new one.")
    ] = None,
) -> None:
    """Compare a real sensor with its model.

    It listens, then sends the requests that only read, and lists them first.

    \b
      tactemu compare optoforce --from /dev/ttyACM0
      tactemu compare weiss_wts --from /dev/ttyACM0 --listen
      tactemu compare brainco_revo2 --from /dev/ttyUSB0 --press
      tactemu compare icub_skin --from hand.log

    What the protocol defines must agree: framing, identifiers, lengths, checksums, constants, counters, answers and
    their times, rates. Rest, noise and clock are numbers of your specimen; they are written to a table that
    `tactemu run --measured` reads. The folder also has the capture, and a report as HTML and JSON.
    Exit code 0 if the protocol agrees, 1 if it differs, 2 for an error in the command, 3 if nothing could be compared.
    See docs/compare.md.
    """
    from tactemu.base.errors import TactemuError
    from tactemu.cli.consoles import message_console
    from tactemu.cli.signals import ended_by_signals
    from tactemu.cli.words import options_of, typed_command
    from tactemu.judge.compare.running import Teller, Wanted, run

    if listen and (ask_all or press):
        raise TactemuError("--listen sends nothing; leave out --ask-all and --press")
    wanted = Wanted(
        device, source, options_of(options or ()), port, baud, seconds, listen, ask_all,
        press_seconds if press else None, presses, out or _new_folder(device), typed_command(),
    )  # fmt: skip
    console = message_console()
    with ended_by_signals() as interrupted, console.status("the model") as status:
        teller = Teller(lambda text: status.update(f"{text} …"), console.print, interrupted)
        try:
            report = run(wanted, teller)
        except KeyboardInterrupt:
            console.print("ended before anything was compared")
            raise typer.Exit(INTERRUPTED) from None
    _print(console, report, wanted.folder)
    raise typer.Exit(_exit_code(report))


def _new_folder(device: str) -> Path:
    """Return an unused name of a folder."""
    stem = f"compared-{device.rpartition(':')[2]}"
    names = (Path(stem if k == 1 else f"{stem}-{k}") for k in range(1, 10_000))
    return next(path for path in names if not path.exists())


def _exit_code(report: CompareReport) -> int:
    if report.interrupted:
        return INTERRUPTED
    if report.comparison.verdicts.protocol:
        return DIFFERS
    return 0 if report.comparison.agrees else NOTHING_COMPARED


def _print(console: Console, report: CompareReport, folder: Path) -> None:
    from rich.text import Text

    from tactemu.cli.consoles import print_row

    found = report.comparison.verdicts
    for mark, color, texts in (
        ("✗", "red", [str(each) for each in found.protocol]),
        ("✓", "green", found.agrees),
        ("·", "cyan", found.notes),
        ("-", "dim", [f"not judged: {each}" for each in found.unjudged]),
    ):
        more = [f"and {len(texts) - MAX_PRINTED} more"] if len(texts) > MAX_PRINTED else []
        for text in [*texts[:MAX_PRINTED], *more]:
            print_row(console, Text(mark, color), text)
    color = "red" if found.protocol else "green" if found.agrees else "yellow"
    console.print(Text.assemble((report.verdict, color), f"; {folder / 'report.html'}"))
    if evidence := report.evidence():
        console.print("For the facts of the device file:")
        console.print(evidence, markup=False, soft_wrap=True)
