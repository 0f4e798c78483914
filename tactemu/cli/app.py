"""The command line: `tactemu --help`, and where its commands are. What each does is imported when it runs."""

from __future__ import annotations

from typing import Annotated

import typer

from tactemu.cli import judging_commands, log_commands, looking_up_commands, running_commands, scene_commands
from tactemu.cli.benches import bench
from tactemu.version import __version__

app = typer.Typer(
    name="tactemu",
    help="""
A simulated tactile skin on the far end of the wire: real sensors' bytes and CAN frames, for unmodified drivers.

\b
  tactemu devices                      what can be emulated
  tactemu run anyskin                  a port, a press, a picture
  tactemu exec anyskin -- ./driver     the driver finds it as /dev/ttyACM0
  tactemu judge anyskin -- ./driver    what the driver does when the wire goes wrong
  tactemu explain anyskin              frames, taxels, and what is simulated and why
  tactemu new hand.toml                a scene file to start from
  tactemu poke press --depth 1mm       what runs already is pressed, moved, broken
  tactemu see                          ... and looked at, on a live page
  tactemu tune hand.toml --rate 500    the most accurate setting that keeps a rate here
  tactemu dataset hand.toml --envs 512 --steps 2000 --out presses   what many feel, as Parquet
  tactemu fit rest.csv --device anyskin --out my_skin.toml   parameters from a recording
  tactemu check my_sensor.py:MySensor  what is wrong with a device of your own
""",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

for each in (running_commands, judging_commands, looking_up_commands, scene_commands, log_commands):
    app.add_typer(each.commands)
app.add_typer(bench, name="bench")


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"tactemu {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass
