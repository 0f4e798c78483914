"""Commands that compute with a scene: tune, dataset and fit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactemu.base.errors import TactemuError, reason_of
from tactemu.cli import INTERRUPTED
from tactemu.cli.parameters import Compute, Target, quantity_of
from tactemu.cli.sections import in_sections
from tactemu.cli.words import pairs_of, typed_command

if TYPE_CHECKING:
    from tactemu.datasets.spec import DatasetSpec

commands = typer.Typer(rich_markup_mode=None)


@commands.command()
def tune(
    target: Target,
    rate: Annotated[
        float,
        typer.Option(
            "--rate",
            metavar="HZ",
            parser=quantity_of("--rate", "Hertz"),
            help="Samples per second that every skin must keep.",
        ),
    ],
    error: Annotated[
        str | None,
        typer.Option(
            metavar="METRIC",
            help="Measure of the error: taxels (RMS), total (of the sum), worst, pressure, drag (tangential sum) or "
            "edges (the contact's border).  [default: the largest that the scene shows]",
        ),
    ] = None,
    seconds: Annotated[
        float,
        typer.Option(
            metavar="S",
            parser=quantity_of("--seconds", low=0.01, high=1000.0),
            help="How much of the scene is simulated.",
        ),
    ] = 4.0,
    write: Annotated[bool, typer.Option(help="Write the choice into the scene file.")] = True,
    device: Compute = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Choose the most accurate setting that keeps a rate.

    It tries the sensor models and their settings on this machine.

    \b
      tactemu tune hand.toml --rate 500
      tactemu tune anyskin --rate 100 --error total

    It measures the cost and the error of every setting on your scene, prints them, and writes the choice into the file.
    The error is that of the pressures, of the drag if a body slides, and of the contact's border if it touches with an
    edge: the largest of them. Devices that read sums of all taxels are judged by the total.
    """
    from tactemu.base.kernels import start_warp
    from tactemu.cli.fitting import print_fitted
    from tactemu.cli.progress import show_progress
    from tactemu.tune.choice import as_dict
    from tactemu.tune.tuner import run_tune

    start_warp()
    say = (lambda _text: None) if json else print_fitted
    choices = run_tune(
        target, rate, error=error, report=say, seconds=seconds, write=write, device=device, progress=show_progress
    )
    if json:
        import json as encoder

        typer.echo(encoder.dumps([as_dict(choice) for choice in choices], indent=1))


@commands.command(
    cls=in_sections({
        "Contents": "steps envs every shift turn bytes_envs seed",
        "Output and machines": "out compression device partitions cluster",
    })
)  # fmt: skip
def dataset(
    target: Target,
    steps: Annotated[int, typer.Option(metavar="N", help="Steps of the simulation in each environment.")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the dataset, empty or new.")],
    envs: Annotated[int, typer.Option(metavar="N", help="Number of parallel environments.")] = 64,
    every: Annotated[int, typer.Option(metavar="N", help="Write a row every N steps.")] = 1,
    shift: Annotated[
        tuple[float, float, float],
        typer.Option(metavar="X Y Z", help="Shift bodies at the start by up to ± X, Y, Z, at random [mm]."),
    ] = (1.0, 1.0, 0.2),
    turn: Annotated[float, typer.Option(metavar="DEG", help="Turn them about z by up to ± DEG, at random.")] = 0.0,
    bytes_envs: Annotated[
        int | None,
        typer.Option(metavar="K", help="Also write the bytes on the wire of the first K environments.  [default: 16]"),
    ] = None,
    seed: Annotated[int | None, typer.Option(metavar="N", help="Seed of all random numbers.")] = None,
    device: Compute = None,
    partitions: Annotated[
        int, typer.Option(metavar="N", help="Simulate the environments in N parts, for memory or for a cluster.")
    ] = 1,
    cluster: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="A Dask scheduler; its workers must reach DIR.")
    ] = None,
    compression: Annotated[
        str, typer.Option(metavar="HOW", help="Compression of the files: lz4, zstd or none.")
    ] = "lz4",
) -> None:
    """Make a dataset of many environments, as Parquet.

    It has the readings of each skin, ideal and measured.

    \b
      tactemu dataset hand.toml --steps 2000 --out presses
      tactemu dataset hand.toml --envs 512 --steps 99 --device cuda:0 --out out
      tactemu dataset hand.toml --steps 99 --cluster tcp://host:8786 --out presses

    It prints the size before it begins. If it was stopped or killed, the same command continues it. The same seed gives
    the same files.
    """
    import math

    from tactemu.base.kernels import start_warp
    from tactemu.datasets.spec import DatasetSpec
    from tactemu.scene.file import load

    start_warp()
    world, (x, y, z) = load(target).tables.scene, shift
    spec = DatasetSpec(
        target=target, envs=envs, steps=steps, every=every, seed=world.seed if seed is None else seed,
        device=device or world.compute, partitions=partitions,
        bytes_envs=min(16, envs) if bytes_envs is None else bytes_envs,
        shift_m=(1e-3 * x, 1e-3 * y, 1e-3 * z), turn_rad=math.radians(turn), compression=compression,
    )  # fmt: skip
    raise typer.Exit(_make_dataset(spec, out, cluster))


def _make_dataset(spec: DatasetSpec, folder: Path, cluster: str | None) -> int:
    """Make a dataset with a progress bar on stderr, and return the exit code.

    Raises:
        TactemuError: the request is invalid, or the folder cannot be written.
    """
    from tactemu.cli.progress import show_sum
    from tactemu.cli.signals import ended_by_signals, interrupt
    from tactemu.datasets.generation import begin, make

    try:
        estimate = begin(spec, folder)
        typer.echo(f"{folder}: {estimate}, and the wire of {spec.bytes_envs} environments")
        with ended_by_signals(interrupt):
            show_sum(make(spec, folder, cluster), "shards", estimate.shards)
    except KeyboardInterrupt:
        typer.echo("stopped; the same command continues from here", err=True)
        return INTERRUPTED
    except OSError as error:
        raise TactemuError(f"{folder}: {reason_of(error, folder)}") from None
    typer.echo(f"{folder}: done; README.md describes the files")
    return 0


@commands.command("fit")
def fit_recordings(
    recordings: Annotated[
        list[Path], typer.Argument(metavar="RECORDING", help=".csv, .csv.gz, .npz, .parquet, .mcap or .jsonl.")
    ],
    sensor: Annotated[
        str, typer.Option("--sensor", metavar="NAME", help="The recorded sensor, a name of `tactemu devices`.")
    ],
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The scene file to write.")],
    columns: Annotated[
        str | None,
        typer.Option(
            metavar="ROLE=COLUMNS,...", help="Roles of the columns, t=t_s,z=z_mm,field=b0x:b4z; default: their names."
        ),
    ] = None,
    unit: Annotated[
        list[str] | None,
        typer.Option(
            "--unit", metavar="ROLE=UNIT,...", help="Units of the roles, z=mm,field=uT; default: SI; repeatable."
        ),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            metavar="HZ", parser=quantity_of("--rate", "Hertz"), help="Rate of the rows, if they have no times."
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The report to write (HTML); default: beside --out.")
    ] = None,
) -> None:
    """Fit a sensor's parameters to recordings of it.

    It writes a scene file with the parameters, and a report.

    \b
      tactemu fit rest.csv --sensor anyskin --out my.toml --columns field=b0x:b4z
      tactemu fit a.csv --sensor anyskin --out my.toml --unit force=N,field=uT

    Roles are t, x, y, z, depth, force, mass, temperature, untouched, and one for the sensor's readings: field, counts,
    pressure, resistance, capacitance or reading. For each parameter that the recordings do not determine, the output
    names what to record next. Needs scipy.
    """
    from tactemu.cli.progress import show_progress
    from tactemu.fit.fitting import run_fit
    from tactemu.fit.recording import read

    roles, units = pairs_of("--columns", columns), pairs_of("--unit", ",".join(unit) if unit else None)
    recorded = [read(path, roles, units, rate) for path in recordings]
    page = report or out.with_suffix(".html")
    run_fit(
        recorded, device=sensor, out=out, report=page, command=typed_command(), say=typer.echo, progress=show_progress
    )
