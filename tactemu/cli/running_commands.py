"""Commands for what runs: on a port, in a view of the machine, driven and seen."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactemu.cli.parameters import (
    Compute,
    Faults,
    Measured,
    Options,
    Ports,
    Rates,
    RunName,
    SaveAt,
    Seconds,
    Seed,
    Target,
    TruthFile,
    TruthKeep,
    WebHost,
    WebPort,
)

commands = typer.Typer(rich_markup_mode=None)


@commands.command()
def run(
    target: Target,
    options: Options = None,
    port: Ports = None,
    rate: Rates = None,
    seed: Seed = None,
    seconds: Seconds = None,
    device: Compute = None,
    fault: Faults = None,
    measured: Measured = False,
    truth: TruthFile = None,
    truth_keep: TruthKeep = None,
    rerun: Annotated[bool, typer.Option("--rerun", help="Show it in Rerun's viewer, too.")] = False,
    rerun_to: Annotated[
        str | None,
        typer.Option(metavar="URL", help="The same in one that listens: rerun+http://127.0.0.1:9876/proxy."),
    ] = None,
    web: Annotated[bool, typer.Option("--web", help="Show it on a live page, too: see `tactemu see`.")] = False,
    web_port: WebPort = None,
    web_host: WebHost = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON lines instead of the picture.")] = False,
    plain: Annotated[
        bool, typer.Option("--plain", help="Log lines instead of the picture, on a terminal too.")
    ] = False,
    clock: Annotated[
        str,
        typer.Option(
            metavar="CLOCK",
            help="real; virtual: as fast as it can, needs --seconds; lockstep: time advances only by `poke step`.",
        ),
    ] = "real",
    virtual: Annotated[bool, typer.Option("--virtual", hidden=True)] = False,
    preempt: Annotated[
        bool, typer.Option("--preempt", help="Go before other programs, so that a busy machine makes no frame late.")
    ] = False,
    name: RunName = None,
    adjustable: Annotated[
        list[str] | None,
        typer.Option(metavar="OPTION", help="An imperfection that `poke set` shall switch on, or `dead`; repeatable."),
    ] = None,
    again: Annotated[
        Path | None,
        typer.Option(
            metavar="LOG",
            help="Do again what was done live in the run of this truth log; on memory: also what its driver said.",
        ),
    ] = None,
    restore: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Go on from a state that was saved of such a run.")
    ] = None,
    save: Annotated[Path | None, typer.Option(metavar="FILE", help="Save the whole state at the end.")] = None,
    save_at: SaveAt = None,
) -> None:
    """Put a device on a port and run it until Ctrl-C.

    \b
      tactemu run anyskin
      tactemu run anyskin --port pty:/tmp/skin --rate 200 --fault 'drop 1%'
      tactemu run optoforce axes=6
      tactemu run hand.toml --port fingertip=pty:/tmp/a --port palm=pty:/tmp/b
      tactemu run linker_hand_l6 --port can:socketcan:vcan0
      tactemu run anyskin --measured                            # noise and steps of a real one
      tactemu run hand.toml --fault 'unplug at 3s for 0.5s' --truth truth.mcap
      tactemu run my_sensor.py:MySensor --port tcp:127.0.0.1:5000
      tactemu run anyskin --port memory: --clock virtual --seconds 10 --json
      tactemu run hand.toml --name hand --adjustable noise      # and then `tactemu poke --help`
      tactemu run hand.toml --web                               # a page to look at it, and to touch it
      tactemu run hand.toml --save pressed.npz --seconds 3      # and then --restore pressed.npz

    One line says where the port is; then a live picture, or log lines when the output is no terminal.
    Exit code 0 after Ctrl-C, SIGTERM or --seconds; 128 + n after signal n before the port is there; 2 when something
    in the request is wrong; 4 when it ran, but a file that was asked for is not whole.
    """
    from tactemu.base.errors import SceneError
    from tactemu.cli.running import Web, run_target

    if virtual:
        raise SceneError("--virtual is now --clock virtual")
    run_target(
        target, options=options or (), ports=tuple(port or ()), rates=tuple(rate or ()), seed=seed, seconds=seconds,
        compute=device, faults=tuple(fault or ()), truth=truth, keep=truth_keep,
        style="json" if json else "plain" if plain else "auto", clock=clock, preempt=preempt, name=name,
        adjustable=tuple(adjustable or ()), again=again, rerun=rerun_to or rerun, restore=restore, save=save,
        save_at=save_at, web=Web(web_host, web_port) if web or web_port is not None or web_host else None,
        measured=measured,
    )  # fmt: skip


@commands.command(
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []},
)
def poke(context: typer.Context) -> None:
    """Press, move, break, or look at what runs."""
    from tactemu.cli.control import main

    main(context.args)


@commands.command()
def see(
    name: Annotated[str | None, typer.Argument(help="Of the emulator; default: the only one that runs.")] = None,
    port: WebPort = None,
    host: WebHost = None,
) -> None:
    """Show what runs on a live page.

    Bodies, taxels, curves, the wire; drag, press, unplug.

    \b
      tactemu run hand.toml               # in one terminal; or a test, `tactemu exec`, `tactemu replay`
      tactemu see                         # in another: a link for a browser on this machine
      tactemu see hand --web-port 9000
      tactemu see --web-host 0.0.0.0      # others may look and touch, who have the link

    Until Ctrl-C. When the emulator ends, the page keeps its last picture, and shows the next run of that name.
    """
    from tactemu.cli.page import see_emulator

    see_emulator(name, host=host, port=port)


@commands.command("exec")
def execute(
    context: typer.Context,
    target: Target,
    options: Options = None,
    node: Annotated[
        list[str] | None,
        typer.Option(
            "--node",
            metavar="NODE",
            help="Name of the port, such as ttyUSB0; default: as the kernel would name it. Of several skins SKIN=NODE, "
            "repeatable.",
        ),
    ] = None,
    port: Annotated[
        list[str] | None,
        typer.Option(
            "--port",
            metavar="PORT",
            help="Where a device on the network is: tcp:6000, ws:0, as for `tactemu run`; default: its usual port.",
        ),
    ] = None,
    rate: Rates = None,
    seed: Seed = None,
    device: Compute = None,
    fault: Faults = None,
    measured: Measured = False,
    truth: TruthFile = None,
    truth_keep: TruthKeep = None,
    way: Annotated[
        str,
        typer.Option(
            "--way",
            metavar="WAY",
            help="How CAN buses are made: native (vcan); preload, where the kernel has none; guest, in a kernel of "
            "their own; default: native or preload, as it can be.",
        ),
    ] = "",
    expose: Annotated[
        list[str] | None,
        typer.Option(
            "--expose",
            metavar="tcp:PORT",
            help="With a CAN bus: a port that leads from the view to the machine's server there, or else from the "
            "machine to the view's; repeatable.",
        ),
    ] = None,
    name: RunName = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Do not say which port is whose.")] = False,
) -> None:
    """Run a driver that finds the device as hardware.

    As /dev/ttyUSB0 with its USB ids, modem lines and unplugging, or as can0.

    \b
      tactemu exec robotiq_tsf85 -- python quick_start.py
      tactemu exec hand.toml --node ttyUSB0 -- ./reader
      tactemu exec anyskin --fault 'unplug at 3s for 1s' -- ./reader     # or `tactemu poke unplug` from elsewhere
      tactemu exec hand.toml --node thumb=ttyUSB0 --node palm=ttyACM0 -- bash
      tactemu exec linker_hand_l6 -- candump can0

    The program, and what it starts, runs in a private view of this machine; the network stays, but where there is a
    CAN bus, which takes a network of its own: loopback, the buses, and what --expose carries through. Terminal,
    standard streams and signals are its own. When it ends, the emulator does.
    Exit code: that of the program, 128 + n after signal n; 125 when something of tactemu's fails, 126 when the program
    cannot be executed, 127 when there is none of that name. See docs/exec.md.
    """
    from tactemu.base.errors import TactemuError
    from tactemu.cli.executing import run_command
    from tactemu.cli.forwarding import FORWARDING

    try:
        status = run_command(
            target, context.obj or (), options=options or (), nodes=tuple(node or ()),
            ports=tuple(port or ()), rates=tuple(rate or ()),
            seed=seed, compute=device, faults=tuple(fault or ()), truth=truth, keep=truth_keep, quiet=quiet,
            way=way, expose=tuple(expose or ()), name=name, signals=FORWARDING[-1], measured=measured,
        )  # fmt: skip
    except TactemuError as error:
        typer.echo(f"tactemu: {error}", err=True)
        status = 125
    raise typer.Exit(status)
