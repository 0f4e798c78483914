"""The command ``tactemu infer``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

commands = typer.Typer(rich_markup_mode=None)


@commands.command()
def infer(
    captures: Annotated[
        list[Path],
        typer.Argument(
            metavar="CAPTURE",
            help="Recordings of `tactemu record`, candump's logs, hex dumps (.hex, .txt), or raw bytes (.bin).",
        ),
    ],
    out: Annotated[Path | None, typer.Option("-o", "--out", metavar="FILE", help="The device file to write.")] = None,
    catalogue: Annotated[bool, typer.Option(help="Compare with the devices of the catalogue first.")] = True,
    shown: Annotated[
        Path | None,
        typer.Option(metavar="CSV", help="What the vendor's program showed meanwhile: names, then numbers."),
    ] = None,
    dbc: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a DBC file of the CAN signals.")] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw which channels answer together (.svg).")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable.")] = False,
) -> None:
    """Draft a device file from what a real sensor sent.

    \b
      tactemu record presses.mcap --from /dev/ttyACM0 --seconds 20
      tactemu infer presses.mcap -o my_sensor.py
      tactemu infer bus.log --dbc bus.dbc --picture channels.svg
      tactemu infer presses.mcap --shown vendor.csv --no-catalogue

    It finds framing, checksum, counters and fields, and says of each whether it is certain, with the proof, or likely,
    with the capture that would decide it. Press each taxel slowly, to full scale and back.
    """
    from tactemu.cli.fitting import print_fitted
    from tactemu.cli.words import typed_command
    from tactemu.fit.infer.commands import InferFiles, run_infer

    files = InferFiles(out, dbc, picture, typed_command())
    run_infer(
        captures, catalogue=catalogue, shown=shown, files=files, json=json, say=typer.echo if json else print_fitted
    )
