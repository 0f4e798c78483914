"""``tactemu new`` and ``tactemu examples``: files to start from."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Annotated

import typer

from tactemu.base.errors import TactemuError, reason_of
from tactemu.base.files import writing
from tactemu.base.folders import EXAMPLES
from tactemu.cli.fitting import print_fitted

START = Path(__file__).parents[1] / "scene" / "start.toml"


commands = typer.Typer(rich_markup_mode=None)


@commands.command()
def new(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The scene file to write, such as hand.toml.")],
) -> None:
    """Write a scene file to start from.

    The scene has a fingertip and a ball, and comments on every key.

    \b
      tactemu new hand.toml
      tactemu run hand.toml
    """
    if file.suffix != ".toml":
        raise TactemuError(f"{file}: the name of a scene file must end in .toml")
    _write(file, START.read_text(encoding="utf-8"))
    typer.echo(f"{file} is written; `tactemu run {file}` runs it")


@commands.command()
def examples(
    folder: Annotated[
        Path | None,
        typer.Argument(metavar="FOLDER", help="Copy the examples into this folder, and create it if needed."),
    ] = None,
) -> None:
    """List the examples, or copy them into a folder.

    \b
      tactemu examples
      tactemu examples tactile
    """
    if folder is None:
        width = max(len(path.name) for path in _examples())
        for path in _examples():
            print_fitted(f"{path.name:<{width}}  {_about(path)}")
        typer.echo("\n`tactemu examples FOLDER` copies them there")
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TactemuError(f"{folder}: cannot make the folder: {reason_of(error, folder)}") from None
    for path in _examples():
        _write(folder / path.name, path.read_text(encoding="utf-8"))
        typer.echo(folder / path.name)


def _examples() -> list[Path]:
    folder = next(folder for folder in EXAMPLES if folder.is_dir())
    return sorted(path for path in folder.iterdir() if path.suffix in (".py", ".toml"))


def _about(path: Path) -> str:
    """Return the first sentence of an example's comment or docstring."""
    text = path.read_text(encoding="utf-8")
    about = ast.get_docstring(ast.parse(text)) if path.suffix == ".py" else text.split("\n\n")[0].replace("#", " ")
    return " ".join((about or "").split()).partition(". ")[0].rstrip(".")


def _write(path: Path, text: str) -> None:
    try:
        if path.exists():
            raise TactemuError(f"{path} exists already; name another file")
        with writing(path) as file:
            file.write(text.encode())
    except OSError as error:
        raise TactemuError(f"{path}: cannot write it: {reason_of(error, path)}") from None
