"""The application of the command line without its commands."""

from __future__ import annotations

from typing import Annotated

import typer

from tactemu.version import __version__


def new_application(about: str = "") -> typer.Typer:
    """Return an application that has no commands yet, with the text ``about`` of its help."""
    app = typer.Typer(
        name="tactemu",
        help=about,
        no_args_is_help=True,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_options)
    return app


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"tactemu {__version__}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass
