"""Commands that run an emulator or talk to a running one: run, poke, see and exec."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactemu.cli.fitting import print_fitted
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
from tactemu.cli.sections import in_sections
from tactemu.cli.words import network_ports_of, options_of, ports_of, rate_of

if TYPE_CHECKING:
    from tactemu.view.page.opening import PageListener

DEMO = Path(__file__).parents[1] / "scene" / "demo.toml"

commands = typer.Typer(rich_markup_mode=None)


@commands.command(
    cls=in_sections({
        "Port and time": "port rate clock seconds preempt",
        "Simulation and faults": "seed device measured fault adjustable",
        "Logs and saved states": "truth truth_keep again save save_at restore",
        "Output": "json plain web web_port web_host rerun rerun_to",
    })
)  # fmt: skip
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
    rerun: Annotated[bool, typer.Option("--rerun", help="Also show the run in Rerun's viewer.")] = False,
    rerun_to: Annotated[
        str | None,
        typer.Option(metavar="URL", help="... in a viewer that listens there: rerun+http://127.0.0.1:9876/proxy."),
    ] = None,
    web: Annotated[
        bool, typer.Option("--web", help="Also show the run on a live page, as `tactemu see` does.")
    ] = False,
    web_port: WebPort = None,
    web_host: WebHost = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON lines instead of the picture.")] = False,
    plain: Annotated[
        bool, typer.Option("--plain", help="Print log lines instead of the picture, even on a terminal.")
    ] = False,
    clock: Annotated[
        str,
        typer.Option(
            metavar="CLOCK",
            help="real; virtual: as fast as possible, needs --seconds; lockstep: time advances only by `poke step`.",
        ),
    ] = "real",
    virtual: Annotated[bool, typer.Option("--virtual", hidden=True)] = False,
    preempt: Annotated[
        bool, typer.Option("--preempt", help="Run with real-time priority, so that other programs delay no frame.")
    ] = False,
    name: RunName = None,
    adjustable: Annotated[
        list[str] | None,
        typer.Option(metavar="OPTION", help="An imperfection, or `dead`, that `poke set` can then change; repeatable."),
    ] = None,
    again: Annotated[
        Path | None,
        typer.Option(
            metavar="LOG",
            help="Repeat the live commands of the run in this truth log; on memory: also the bytes of its driver.",
        ),
    ] = None,
    restore: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Continue from the saved state of such a run.")
    ] = None,
    save: Annotated[Path | None, typer.Option(metavar="FILE", help="Save the complete state at the end.")] = None,
    save_at: SaveAt = None,
) -> None:
    """Emulate a device on a port, until Ctrl-C.

    \b
      tactemu run anyskin
      tactemu run anyskin --port pty:/tmp/skin --rate 200 --fault 'drop 1%'
      tactemu run optoforce axes=6
      tactemu run hand.toml --port fingertip=pty:/tmp/a --port palm=pty:/tmp/b
      tactemu run linker_hand_l6 --port can:socketcan:vcan0
      tactemu run anyskin --measured             # with the noise of a real one
      tactemu run hand.toml --fault 'unplug at 3s for 0.5s' --truth truth.mcap
      tactemu run my_sensor.py:MySensor --port tcp:127.0.0.1:5000
      tactemu run anyskin --port memory: --clock virtual --seconds 10 --json
      tactemu run hand.toml --adjustable noise   # for `tactemu poke set`
      tactemu run hand.toml --web                # with a page to watch and touch
      tactemu run hand.toml --seconds 3 --save pressed.npz
      tactemu run hand.toml --restore pressed.npz  # continues from there

    The first line names the port; then you see a live picture, or log lines if the output is no terminal.
    Exit code 0 after Ctrl-C, SIGTERM or --seconds; 128 + n after signal n before the port is open; 2 for an error in
    the request; 4 if it ran, but a file that you asked for is incomplete.
    """
    from tactemu.base.errors import SceneError
    from tactemu.cli.run_output import run_session
    from tactemu.session.options import RunOptions
    from tactemu.session.session import Session

    if virtual:
        raise SceneError("--virtual is gone; write --clock virtual")
    _check(clock, seconds, save, save_at, preempt)
    page = _page(web_host, web_port) if web or web_port is not None or web_host else None
    run_options = RunOptions(
        port=ports_of(port or ()), rate_hz=rate_of(rate or ()), device_options=options_of(options or ()),
        faults=fault or (), seed=seed, device=device, measured=measured, adjustable=adjustable or (), by_hand=False,
        truth=truth, keep=truth_keep, clock=clock, preempt=preempt, name=name, default_name=True, again=again,
        seconds=seconds, restore=restore, save=save, save_at=save_at,
    )  # fmt: skip
    _note_shares(fault or ())
    style = "json" if json else "plain" if plain else "auto"
    run_session(Session(target, run_options), style=style, viewer=rerun_to or rerun, page=page)


def _note_shares(faults: Sequence[str]) -> None:
    """Print which faults hit every frame, as their text names no share and no time."""
    from tactemu.wire.faults import parse
    from tactemu.wire.faults.fault import FrameFault

    for text in faults:
        fault = parse(text)
        if isinstance(fault, FrameFault) and text.strip() == fault.word:
            print(f"fault {text!r}: it hits every frame; for one in ten write '{text} 10%'", file=sys.stderr)


def _page(host: str | None, port: int | None) -> PageListener:
    from tactemu.view.page.opening import open_listener

    return open_listener(host, port)


def _check(clock: str, seconds: float | None, save: Path | None, save_at: float | None, preempt: bool) -> None:
    """Raise if options contradict each other, or the state cannot be written.

    Raises:
        TactemuError: names the option and the remedy.
    """
    from tactemu.base.errors import SceneError, nearest
    from tactemu.base.files import check_writable
    from tactemu.session.options import RUN_CLOCKS

    if clock not in RUN_CLOCKS:
        raise SceneError(f"--clock {clock}: expected {', '.join(RUN_CLOCKS)}{nearest(clock, RUN_CLOCKS)}")
    if clock == "virtual" and seconds is None:
        raise SceneError("--clock virtual runs as fast as possible and would never end; add --seconds")
    if save_at is not None and save is None:
        raise SceneError("--save-at needs the file: add --save FILE")
    if save is not None:
        from tactemu.emulator.saving.state_file import SIGN

        check_writable(save, "the state", SIGN)
    if preempt and clock != "real":
        raise SceneError(f"--preempt is for --clock real only; --clock {clock} is never late")


@commands.command(
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []},
)
def poke(context: typer.Context) -> None:
    """Press, move, break or read a running emulator."""
    from tactemu.cli.control import main

    main(context.args)


@commands.command()
def see(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="Name of the emulator; default: the only one that runs.")
    ] = None,
    demo: Annotated[
        bool, typer.Option("--demo", help="Start a glove that is touched, and show it; needs no driver.")
    ] = False,
    port: WebPort = None,
    host: WebHost = None,
) -> None:
    """Show a running emulator on a live page.

    The page draws bodies, taxels, curves and the wire; you can drag bodies, press taxels and unplug the device.

    \b
      tactemu see --demo               # a glove that is touched, without a driver
      tactemu run hand.toml            # in one terminal; or a test, exec, replay
      tactemu see                      # in another terminal
      tactemu see hand --web-port 9000
      tactemu see --web-host 0.0.0.0   # others with the link may watch and touch

    It prints a link for a browser on this machine. Ctrl-C ends it. When the emulator ends, the page keeps the last
    picture, and shows the next run of that name.
    """
    if demo:
        _show_demo(name, _page(host, port))
        return
    from tactemu.cli.page import show_runs
    from tactemu.control.endpoints import chosen

    place = chosen(name)
    show_runs(place.stem, _page(host, port))


def _show_demo(name: str | None, page: PageListener) -> None:
    """Run the scene of the demo with its page until Ctrl-C."""
    print_fitted(
        "A glove and three objects that touch it; no driver is needed. Open the link in a browser, drag an object, "
        "click a taxel. Ctrl-C ends it.",
        page.url,
    )
    with contextlib.suppress(KeyboardInterrupt):  # before the loop runs
        from tactemu.cli.run_output import run_session
        from tactemu.session.options import RunOptions
        from tactemu.session.session import Session

        options = RunOptions(port="memory:", name=name, default_name=True)
        run_session(Session(str(DEMO), options), style="quiet", page=page)


@commands.command(
    "exec",
    cls=in_sections({
        "Port and rate": "node port rate way expose",
        "Simulation and faults": "seed device measured fault",
        "Logs and output": "truth truth_keep quiet",
    }),
)  # fmt: skip
def execute(
    context: typer.Context,
    target: Target,
    options: Options = None,
    node: Annotated[
        list[str] | None,
        typer.Option(
            "--node",
            metavar="NODE",
            help="Name of the port, such as ttyUSB0; default: as the kernel would name it. With several skins give "
            "SKIN=NODE for each; repeatable.",
        ),
    ] = None,
    port: Annotated[
        list[str] | None,
        typer.Option(
            "--port",
            metavar="PORT",
            help="Address of a device on the network: tcp:6000, ws:0, as for `tactemu run`; default: its usual port.",
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
            help="How CAN buses are provided: native (vcan); preload, for a kernel without CAN; guest, in a kernel of "
            "their own. Default: native if the kernel can, else preload.",
        ),
    ] = "",
    expose: Annotated[
        list[str] | None,
        typer.Option(
            "--expose",
            metavar="tcp:PORT",
            help="With a CAN bus: forward this port from the view to the machine's server, or, if the machine has "
            "none, from the machine to the view's server; repeatable.",
        ),
    ] = None,
    name: RunName = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Do not print which port is which skin.")] = False,
) -> None:
    """Run a driver that finds the device as hardware.

    The driver sees /dev/ttyUSB0 with its USB ids, modem lines and unplugging, or can0.

    \b
      tactemu exec robotiq_tsf85 -- python quick_start.py
      tactemu exec hand.toml --node ttyUSB0 -- ./reader
      tactemu exec anyskin --fault 'unplug at 3s for 1s' -- ./reader
      tactemu exec hand.toml --node thumb=ttyUSB0 --node palm=ttyACM0 -- bash
      tactemu exec linker_hand_l6 -- candump can0

    The program and its children run in a private view of this machine. They keep its network, unless there is a CAN
    bus: then they have a network of their own with loopback, the buses and the ports of --expose. The program has the
    terminal, the standard streams and the signals. When it ends, the emulator ends.
    Exit code: that of the program, or 128 + n after signal n; 125 if tactemu fails, 126 if the program cannot be
    executed, 127 if there is none of that name. See docs/exec.md.
    """
    from tactemu.base.errors import TactemuError
    from tactemu.cli.executing import before_start, run_driver
    from tactemu.session.options import RunOptions
    from tactemu.session.session import Session

    command = context.obj or ()
    try:
        status = before_start(target, command, way)
        if not status:
            run_options = RunOptions(
                port=network_ports_of(port or ()), rate_hz=rate_of(rate or ()), seed=seed, device=device,
                device_options=options_of(options or ()), faults=fault or (), measured=measured, by_hand=False,
                truth=truth, keep=truth_keep, name=name, default_name=True, fresh_ports=True, usual_network=True,
            )  # fmt: skip
            view = {"nodes": ports_of(node or (), "node") or "", "way": way, "expose": expose or ()}
            status = run_driver(command, Session(target, run_options), view, quiet=quiet)
    except TactemuError as error:
        typer.echo(f"tactemu: {error}", err=True)
        status = 125
    raise typer.Exit(status)
