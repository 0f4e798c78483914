"""``tactemu dataset``: print the estimate, make the dataset, and show progress."""

from __future__ import annotations

from pathlib import Path

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from tactemu.base.errors import TactemuError
from tactemu.cli import INTERRUPTED
from tactemu.cli.signals import ended_by_signals
from tactemu.datasets.generation import begin, make
from tactemu.datasets.spec import DatasetSpec


def make_dataset(spec: DatasetSpec, folder: Path, cluster: str | None) -> int:
    """Make a dataset with a progress bar on stderr, and return the exit code.

    Raises:
        TactemuError: the request is invalid, or the folder cannot be written.
    """
    try:
        estimate = begin(spec, folder)
        typer.echo(f"{folder}: {estimate}, and the wire of {spec.bytes_envs} environments")
        columns = (TextColumn("shards"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        left = (TextColumn("left"), TimeRemainingColumn())
        console = Console(stderr=True)
        with (
            ended_by_signals(_interrupt),
            Progress(*columns, *left, console=console, transient=True, disable=not console.is_terminal) as progress,
        ):
            task = progress.add_task("", total=estimate.shards)
            for more in make(spec, folder, cluster):
                progress.advance(task, more)
    except KeyboardInterrupt:
        typer.echo("stopped; the same command continues from here", err=True)
        return INTERRUPTED
    except OSError as error:
        raise TactemuError(f"{folder}: {error.strerror or error}") from None
    typer.echo(f"{folder}: done; README.md describes the files")
    return 0


def _interrupt() -> None:
    raise KeyboardInterrupt
