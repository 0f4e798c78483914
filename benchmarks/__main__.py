"""The commands of the benchmarks of this project's own machinery: ``python -m benchmarks --help``.

The benchmarks for users are those of ``tactemu bench``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactemu.cli.benches import Out, save

bench = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="""
Measure this tree on this machine. Figures are medians; compare those of one run.

\b
  python -m benchmarks loop     time to the first frame, lateness of frames
  python -m benchmarks on_time  samples, answers, commands, closed loop: each with its limit
  python -m benchmarks frames   processor time of a sample, and of a frame between device and port
  python -m benchmarks layer    the elastic layer: grids, contact areas, batches
  python -m benchmarks steps    processor time of steps, in pairs with another commit
  python -m benchmarks reality  the levels of fidelity against presses on a real skin
  python -m benchmarks state    size and time of a saved state, and of a fork
  python -m benchmarks soak     half an hour at 1 kHz and 5 % faults: leaks and lost frames
  python -m benchmarks control  live commands: their delay and their cost
  python -m benchmarks page     the live page: its cost for the loop, pictures a second
  python -m benchmarks exec     cost of a driver's view of the machine, and 1000 replugs
  python -m benchmarks judge    trials of `tactemu judge` a minute, one and two at once
  python -m benchmarks infer    what `tactemu infer` finds in captures of every device
  python -m benchmarks bus      a robot's complete skin on CAN: how many boards are in time
  python -m benchmarks wires    echo, rate and jitter of UARTs and USB chips in a guest's kernel
  python -m benchmarks same     what this tree and another commit transmit and measure, byte for byte
  python -m benchmarks mutants  defects that the tests must find, each tried in a copy of the tree
""",
)


@bench.command()
def loop(
    seconds: Annotated[float, typer.Option(metavar="S", min=0.1, help="Length of each lateness run.")] = 60.0,
    repeats: Annotated[int, typer.Option(metavar="N", min=1, help="Number of starts with a filled kernel cache.")] = 5,
    questions: Annotated[int, typer.Option(metavar="N", min=1, help="Number of requests on each port.")] = 10_000,
    only: Annotated[str, typer.Option(metavar="WHAT", help="Measure only open or closed loops.")] = "",
    out: Out = None,
) -> None:
    """Measure first frame, lateness, answers, and a closed loop.

    The first frame comes with an empty and a filled kernel cache, lateness at 100 Hz and 1 kHz. In the closed loop
    MuJoCo moves a hand: its steps a second and the time from contact to wire, with and without a page.
    """
    from benchmarks.loop import run

    if only not in ("", "open", "closed"):
        raise typer.BadParameter(f"expected open or closed, got {only!r}", param_hint="--only")
    save(run(typer.echo, seconds=seconds, repeats=repeats, questions=questions, only=only), out)


@bench.command("on_time")
def on_time(
    seconds: Annotated[
        float, typer.Option(metavar="S", min=0.1, help="Length of the run at 1 kHz; the other parts are shorter.")
    ] = 60.0,
    out: Out = None,
) -> None:
    """Measure all that must be on time, each with its limit, in less than four minutes on a quiet machine.

    The exit code is 1 if a limit is not met.
    """
    from benchmarks.on_time import run
    from tactemu.base.kernels import start_warp

    start_warp()
    figures, is_met = run(typer.echo, seconds=seconds)
    save(figures, out)
    raise typer.Exit(0 if is_met else 1)


@bench.command()
def frames(
    repeats: Annotated[int, typer.Option(metavar="N", min=1, help="Number of runs, of which the least counts.")] = 9,
    out: Out = None,
) -> None:
    """Measure the processor time of a sample of AnySkin, and of frames on serial lines, CAN and a pseudo terminal."""
    from benchmarks.frames import run

    save(run(typer.echo, repeats=repeats), out)


@bench.command()
def wires(
    repeats: Annotated[int, typer.Option(metavar="N", min=1, help="Measurements, of which the quietest counts.")] = 3,
    out: Out = None,
) -> None:
    """Measure UARTs and USB-serial chips in a guest with Debian's kernel: echo, rate and jitter, each with a plug."""
    from benchmarks.wires import run

    save(run(typer.echo, repeats), out)


@bench.command()
def same(
    commit: Annotated[str, typer.Argument(help="Commit to compare with; default: before the tree was tidied.")] = "",
    replay: Annotated[bool, typer.Option(help="Replay the client recordings of that commit, too.")] = True,
) -> None:
    """Compare the bytes of every device and the readings of every sensor model with those of another commit."""
    from benchmarks.same import BASE, run

    raise typer.Exit(0 if run(typer.echo, commit or BASE, replay) else 1)


@bench.command()
def mutants(
    only: Annotated[str, typer.Option(metavar="TEXT", help="Try only mutants whose name contains this.")] = "",
) -> None:
    """Put one defect after another into a copy of the tree, and run the tests that must find it.

    The exit code is 0 if all mutants are killed, and 1 if one lives. A mutant whose text the tree no longer has is an
    error: adapt it in `benchmarks/mutants.py`.
    """
    from benchmarks.mutants import run

    try:
        is_complete = run(typer.echo, only)
    except (RuntimeError, ValueError) as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(2) from None
    raise typer.Exit(0 if is_complete else 1)


@bench.command()
def soak(
    minutes: Annotated[float, typer.Option(metavar="M", min=0.05, help="Length of the run.")] = 30.0,
    interval: Annotated[float, typer.Option(metavar="S", min=1.0, help="Seconds between two measurements.")] = 60.0,
    out: Out = None,
) -> None:
    """Measure memory, file descriptors, lateness and lost frames at 1 kHz with 5 % faults."""
    from benchmarks.soak import run
    from tactemu.base.kernels import start_warp

    start_warp()
    save(run(typer.echo, minutes=minutes, interval_s=interval), out)


@bench.command()
def control(
    seconds: Annotated[float, typer.Option(metavar="S", min=1.0, help="Length of each of two runs.")] = 60.0,
    out: Out = None,
) -> None:
    """Send 10,000 commands a minute to one of two skins: lateness, delay of the effect, the other skin's bytes."""
    from benchmarks.control import run

    save(run(typer.echo, seconds=seconds), out)


@bench.command("exec")
def execute(
    cycles: Annotated[int, typer.Option(metavar="N", min=1, help="Number of replugs.")] = 1000,
    out: Out = None,
) -> None:
    """Measure start, read and write of a program in `tactemu exec`, and what unplugging leaves behind."""
    from benchmarks.exec import run
    from tactemu.base.kernels import start_warp

    start_warp()
    save(run(typer.echo, cycles=cycles), out)


@bench.command()
def page(
    pairs: Annotated[
        int, typer.Option(metavar="N", min=1, help="Number of pairs of runs, without and with a page.")
    ] = 5,
    seconds: Annotated[float, typer.Option(metavar="S", min=3, help="Length of each run.")] = 8.0,
    only: Annotated[str, typer.Option(metavar="WHAT", help="Measure only lateness or pictures.")] = "",
    preempt: Annotated[bool, typer.Option("--preempt", help="Run with real-time priority.")] = False,
    out: Out = None,
) -> None:
    """Measure lateness with and without a page of four viewers, and pictures of 4,200 taxels a second."""
    from benchmarks.page import run

    save(run(typer.echo, pairs=pairs, seconds=seconds, only=only, preempt=preempt), out)


@bench.command()
def bus(
    boards: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="Number of boards; default: more and more, until frames are late."),
    ] = None,
    seconds: Annotated[float, typer.Option(metavar="S", min=1, help="Length of each run.")] = 10.0,
    way: Annotated[str, typer.Option(metavar="WAY", help="native or preload; default: native if the kernel can.")] = "",
    out: Out = None,
) -> None:
    """Measure the lateness of iCub boards of 70 taxels at 50 Hz, six on a bus, read by another process."""
    from benchmarks.bus import run
    from tactemu.base.kernels import start_warp

    start_warp()
    save(run(typer.echo, boards=boards, seconds=seconds, way=way), out)


@bench.command()
def state(
    repeats: Annotated[int, typer.Option(metavar="N", min=1, help="Repeats of each measurement.")] = 10,
    forks: Annotated[int, typer.Option(metavar="N", min=1, help="Number of simultaneous forks.")] = 100,
    only: Annotated[str, typer.Option(metavar="TEXT", help="Only devices and models whose name contains this.")] = "",
    out: Out = None,
) -> None:
    """Measure size and time of a saved state, and memory of a fork, for some devices and every sensor model."""
    from benchmarks.state import run
    from tactemu.base.kernels import start_warp

    start_warp()
    save(run(typer.echo, repeats=repeats, forks=forks, only=only), out)


@bench.command()
def reality(
    data: Annotated[Path, typer.Argument(metavar="DATA", help="Folder of recordings with eflesh/normal_*.csv.gz.")],
    page: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the table as a page.")] = None,
    out: Out = None,
) -> None:
    """Measure the error of every level of fidelity on presses of a real skin, with and without laws of its material."""
    from benchmarks.reality import run
    from tactemu.base.kernels import start_warp

    start_warp()
    save(run(typer.echo, data, page), out)


@bench.command()
def infer(
    names: Annotated[list[str] | None, typer.Argument(metavar="[DEVICE]...", help="Default: all.")] = None,
    page: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the tables into a page.")] = None,
    folder: Annotated[Path, typer.Option(metavar="DIR", help="The captures; those that are missing are made.")] = Path(
        "/tmp/infer-corpus"
    ),
    seconds: Annotated[float, typer.Option(metavar="S", help="Length of a capture that is made.")] = 20.0,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of its noise.")] = 1,
) -> None:
    """Judge `tactemu infer` on captures of every serial and CAN device, with and without times."""
    from benchmarks.infer import run

    run(typer.echo, names or (), folder=folder, page=page, seconds=seconds, seed=seed)


@bench.command()
def layer(
    device: Annotated[str, typer.Option("--device", metavar="DEV", help="Where kernels run: cpu or cuda:0.")] = "cpu",
    envs: Annotated[int | None, typer.Option(metavar="N", help="Size of the batch; default: 4096 on a GPU.")] = None,
    only: Annotated[str, typer.Option(metavar="TEXT", help="Only figures whose title contains this.")] = "",
    out: Out = None,
) -> None:
    """Measure warm steps of ElasticLayerTaxel on growing grids, growing skins, growing contacts, and in batches."""
    from benchmarks.layer import run

    save(run(typer.echo, device=device, n_envs=envs, only=only), out)


@bench.command()
def steps(
    commit: Annotated[
        str, typer.Argument(help="Commit to compare with; default: that of the page on performance.")
    ] = "",
    pairs: Annotated[int, typer.Option(metavar="N", min=1, help="Number of runs in each tree.")] = 10,
    only: Annotated[str, typer.Option(metavar="TEXT", help="Only cases whose name contains this.")] = "",
    out: Out = None,
) -> None:
    """Measure steps of the sensor models on a CPU, alternating with another commit."""
    from benchmarks.steps import BASE, run

    save(run(typer.echo, commit or BASE, pairs, only), out)


@bench.command()
def judge(
    runs: Annotated[int, typer.Option(metavar="N", min=2, help="Number of runs two at once; half as many alone.")] = 4,
    dask: Annotated[bool, typer.Option(help="Also measure workers of Dask, if it is installed.")] = True,
    out: Out = None,
) -> None:
    """Measure trials of `tactemu judge` a minute on a clean driver: alone, two at once, and by two workers of Dask."""
    from benchmarks.judge import run

    save(run(typer.echo, runs=runs, workers=dask), out)


if __name__ == "__main__":
    bench(prog_name="python -m benchmarks")
