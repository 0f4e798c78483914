"""`tactemu bench`: a command for each benchmark, imported when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactemu.cli.fitting import print_fitted

bench = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="""
Measure speed and accuracy on this machine. Figures are medians; compare those of one run.

\b
  tactemu bench physics    time of a step, a read and a start, for each sensor
  tactemu bench trade      error and cost of every level of fidelity
  tactemu bench realism    error of the laws of real sensors on recordings
  tactemu bench wire       time of a frame between device and port
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
    device: Annotated[str, typer.Option("--device", metavar="DEV", help="Where kernels run: cpu or cuda:0.")] = "cpu",
    starts: Annotated[bool, typer.Option(help="Also measure starts with an empty and a filled kernel cache.")] = True,
    only: Annotated[str, typer.Option(metavar="TEXT", help="Measure only figures whose name contains this.")] = "",
    largest: Annotated[bool, typer.Option(help="Also find the largest batch that fits on a GPU.")] = False,
    loops: Annotated[bool, typer.Option(help="Also measure loops: poses in, a step, readings out, resets.")] = False,
    page: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the tables as a Markdown page.")] = None,
    out: Out = None,
) -> None:
    """Measure the time of a step and of a read of each sensor.

    The table has their targets, and the figures of Genesis in its own scene.

    \b
      tactemu bench physics
      tactemu bench physics --only probe --no-starts
      tactemu bench physics --device cuda:0 --largest --out speed.json
    """
    from tactemu.base.files import check_writable
    from tactemu.base.kernels import start_warp
    from tactemu.tune.speed.physics import markdown_page, run

    check_writable(page, "the tables", "Written by `tactemu bench physics")
    check_writable(out, "the figures", '_us":', '_s":')
    start_warp()
    figures = run(
        print_fitted, device=device, starts=starts, only=only, largest=largest, loops=loops or page is not None
    )
    if page is not None:
        page.write_text(markdown_page(figures, device), encoding="utf-8")
    save(figures, out)


@bench.command()
def wire(
    repeats: Annotated[int, typer.Option(metavar="N", min=1, help="Number of runs of each stage.")] = 7, out: Out = None
) -> None:
    """Measure the time of a frame from device to port.

    It also prints how many frames a core can send.

    \b
      tactemu bench wire
      tactemu bench wire --repeats 21 --out wire.json
    """
    from tactemu.base.files import check_writable
    from tactemu.tune.speed.wire import run

    check_writable(out, "the figures", '"can bits":')
    save(run(print_fitted, repeats=repeats), out)


@bench.command()
def trade(
    scene: Annotated[
        str | None, typer.Argument(metavar="SCENE", help="A scene file or device, to measure its contacts instead.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", metavar="FOLDER", help="Folder for figures, table and picture.")] = Path(
        "trade"
    ),
    quick: Annotated[bool, typer.Option("--quick", help="Use a coarser truth and twelve cases.")] = False,
    device: Annotated[str, typer.Option("--device", metavar="DEV", help="Where kernels run: cpu or cuda:0.")] = "cpu",
    only: Annotated[str, typer.Option(metavar="TEXT", help="Measure only settings whose name contains this.")] = "",
    fresh: Annotated[bool, typer.Option("--fresh", help="Measure all again instead of continuing.")] = False,
    times: Annotated[bool, typer.Option(help="Measure times, which needs an idle machine, or keep the last.")] = True,
    page: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A Markdown page whose table of settings is replaced.")
    ] = None,
) -> None:
    """Measure error and cost of every setting, and draw them.

    Presses, light presses, edges and drags are tried, each at four places less than a taxel apart. The same command
    continues a stopped run.

    \b
      tactemu bench trade --quick
      tactemu bench trade scene.toml --out scene-trade
      tactemu bench trade --page docs/accuracy.md
    """
    from tactemu.cli.progress import show_progress
    from tactemu.tune.trade.trade import TradeOptions, run_trade

    options = TradeOptions(quick=quick, only=only, fresh=fresh, times=times, page=page)
    run_trade(print_fitted, scene, out=out, device=device, options=options, progress=show_progress)


@bench.command()
def realism(
    data: Annotated[
        Path | None, typer.Argument(metavar="DATA", help="Folder of recordings, with a folder for each set.")
    ] = None,
    held: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Other recordings, to predict with the fitted parameters.")
    ] = None,
    page: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the table as a Markdown page.")] = None,
    parameters: Annotated[Path | None, typer.Option(metavar="FILE", help="Write fitted parameters as JSON.")] = None,
    out: Out = None,
) -> None:
    """Fit the laws of real sensors to recordings.

    It measures how well they predict each recording that is left out.

    \b
      tactemu bench realism
      tactemu bench realism recordings --held others --page realism.md
    """
    from tactemu.base.files import check_writable
    from tactemu.fit.realism import run

    check_writable(out, "the figures", '"left out":')
    save(run(print_fitted, data=data, held=held, page=page, parameters=parameters), out)
