"""`tactemu bench`: one command per benchmark, each imported when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

bench = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="""
Measure speed on this machine. Figures are medians; compare those of one run.

\b
  tactemu bench physics    cost of a step, of a read and of a start, per sensor
  tactemu bench trade      error against truth and cost of every level of fidelity
  tactemu bench realism    how well the laws of real sensors predict recordings that were left out
  tactemu bench wire       cost of a frame between device and port
""",
)

Out = Annotated[Path | None, typer.Option("--out", metavar="FILE", help="Also write the figures as JSON.")]


def save(figures: object, out: Path | None) -> None:
    """Write figures as JSON, if a file was named."""
    if out is not None:
        import json

        out.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


@bench.command()
def physics(
    device: Annotated[str, typer.Option("--device", metavar="DEVICE", help="cpu, or cuda:0.")] = "cpu",
    starts: Annotated[bool, typer.Option(help="Also starts with an empty and a filled kernel cache.")] = True,
    only: Annotated[str, typer.Option(metavar="TEXT", help="Only figures whose name contains this.")] = "",
    largest: Annotated[bool, typer.Option(help="Also the largest batch that fits on a GPU.")] = False,
    loops: Annotated[bool, typer.Option(help="Also loops: poses in, a step, readings out, resets.")] = False,
    page: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the tables as a page.")] = None,
    out: Out = None,
) -> None:
    """Step and read per sensor, beside the figures aimed at and Genesis's in its own scene; whole loops."""
    from tactemu.base.kernels import start_quietly
    from tactemu.tune.speed.physics import markdown_page, run

    start_quietly()
    figures = run(typer.echo, device=device, starts=starts, only=only, largest=largest, loops=loops or page is not None)
    if page is not None:
        page.write_text(markdown_page(figures, device), encoding="utf-8")
    save(figures, out)


@bench.command()
def wire(
    repeats: Annotated[int, typer.Option(metavar="N", min=1, help="Runs of each stage.")] = 7, out: Out = None
) -> None:
    """What a frame costs from the device to the port, and how many a core can send."""
    from tactemu.tune.speed.wire import run

    save(run(typer.echo, repeats=repeats), out)


@bench.command()
def trade(
    scene: Annotated[
        str | None, typer.Argument(metavar="SCENE", help="A scene file or device: measure its contacts instead.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", metavar="FOLDER", help="Figures, table, picture.")] = Path("trade"),
    quick: Annotated[bool, typer.Option("--quick", help="A coarser truth and ten cases: a minute.")] = False,
    device: Annotated[str, typer.Option("--device", metavar="DEVICE", help="cpu, or cuda:0.")] = "cpu",
    only: Annotated[str, typer.Option(metavar="TEXT", help="Only settings whose name contains this.")] = "",
    fresh: Annotated[bool, typer.Option("--fresh", help="Measure all again instead of going on.")] = False,
) -> None:
    """Error against truth and cost of every setting, with a table and a picture. A stopped run goes on where it was."""
    from tactemu.cli.progress import show_progress
    from tactemu.tune.trade.trade import run_trade

    run_trade(typer.echo, scene, out=out, quick=quick, device=device, only=only, fresh=fresh, progress=show_progress)


@bench.command()
def realism(
    data: Annotated[
        Path | None, typer.Argument(metavar="[DATA]", help="Folder of recordings, one folder for each set.")
    ] = None,
    held: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Other recordings, predicted with what was fitted.")
    ] = None,
    page: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the table as a page.")] = None,
    parameters: Annotated[Path | None, typer.Option(metavar="FILE", help="Write what was fitted as JSON.")] = None,
    out: Out = None,
) -> None:
    """Fit the laws of real sensors to recordings, leave each out in turn, and say how well it is predicted."""
    from tactemu.fit.realism import run

    save(run(typer.echo, data=data, held=held, page=page, parameters=parameters), out)
