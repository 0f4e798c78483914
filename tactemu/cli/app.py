"""The commands and their options. What each does is in a module of its own, imported when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import tactemu
from tactemu.cli.benches import bench

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
  tactemu fit rest.csv --device anyskin --out my_skin.toml   parameters from a recording
  tactemu check my_sensor.py:MySensor  what is wrong with a device of your own
""",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _targets(incomplete: str) -> list[str]:
    """What a shell offers for a target: devices, and scene files here."""
    from firmware_protocols import names

    found = [*names(), *map(str, Path().glob("*.toml"))]
    return [each for each in found if each.startswith(incomplete)]


Target = Annotated[
    str,
    typer.Argument(
        metavar="DEVICE_OR_SCENE",
        help="A device's name, path/to/device.py:Class, or scene.toml.",
        autocompletion=_targets,
    ),
]
Options = Annotated[
    list[str] | None,
    typer.Argument(metavar="[OPTION=VALUE]...", help="Options of a device; `tactemu devices NAME` lists them."),
]
Ports = Annotated[
    list[str] | None,
    typer.Option(
        "--port",
        metavar="PORT",
        help="pty:PATH, can:INTERFACE:CHANNEL, HOST:PORT behind tcp:, rfc2217:, udp: or ws:, dds:DOMAIN or memory:; "
        "of several skins SKIN=PORT, repeatable.",
    ),
]
Rates = Annotated[
    list[str] | None,
    typer.Option(
        "--rate",
        metavar="HZ",
        help="Sampling rate; default: the device's own. Of a device with several streams --rate STREAM=HZ; repeatable.",
    ),
]


def _seconds(text: str, option: str = "--seconds") -> float:
    from tactemu.options import number
    from tactemu.scene.limits import MOST_S

    try:
        given: float | str = float(text)
    except ValueError:
        given = text
    return number("command line", option, given, at_least=0, at_most=MOST_S, unit="s")


def _save_at(text: str) -> float:
    return _seconds(text, "--save-at")


Seconds = Annotated[float | None, typer.Option("--seconds", metavar="S", parser=_seconds, help="Stop after this long.")]
Seed = Annotated[int | None, typer.Option(metavar="N", help="Root of all random numbers; same seed, same bytes.")]
Compute = Annotated[str | None, typer.Option("--device", metavar="DEV", help="Where kernels run: cpu or cuda:0.")]
Faults = Annotated[
    list[str] | None,
    typer.Option("--fault", metavar="FAULT", help="What goes wrong on the wire; repeatable. See `tactemu faults`."),
]

TruthFile = Annotated[
    Path | None,
    typer.Option(
        "--truth", metavar="FILE", help="Write what was felt, sent and injected: .mcap, or .jsonl for JSON lines."
    ),
]
TruthKeep = Annotated[
    str | None,
    typer.Option(
        "--truth-keep", metavar="SIZE", help="Memory for samples and frames; default: the scene's, else 256MB."
    ),
]

RunName = Annotated[
    str | None,
    typer.Option("--name", metavar="NAME", help="For `tactemu poke --name`; default: the target's."),
]

WebPort = Annotated[
    int | None,
    typer.Option("--web-port", metavar="N", min=0, max=65535, help="Of the live page; default: 8080, if it is free."),
]
WebHost = Annotated[
    str | None,
    typer.Option("--web-host", metavar="ADDRESS", help="Let others reach the live page; default: only this machine."),
]

app.add_typer(bench, name="bench")


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"tactemu {tactemu.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


@app.command()
def run(
    target: Target,
    options: Options = None,
    port: Ports = None,
    rate: Rates = None,
    seed: Seed = None,
    seconds: Seconds = None,
    device: Compute = None,
    fault: Faults = None,
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
        typer.Option(metavar="LOG", help="Do again what was done live in the run of this truth log."),
    ] = None,
    restore: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Go on from a state that was saved of such a run.")
    ] = None,
    save: Annotated[Path | None, typer.Option(metavar="FILE", help="Save the whole state at the end.")] = None,
    save_at: Annotated[
        float | None, typer.Option(metavar="S", parser=_save_at, help="When to save it instead [s], once.")
    ] = None,
) -> None:
    """Put a device on a port and run it until Ctrl-C.

    \b
      tactemu run anyskin
      tactemu run anyskin --port pty:/tmp/skin --rate 200 --fault 'drop 1%'
      tactemu run optoforce axes=6
      tactemu run hand.toml --port fingertip=pty:/tmp/a --port palm=pty:/tmp/b
      tactemu run linker_hand_l6 --port can:socketcan:vcan0
      tactemu run hand.toml --fault 'unplug at 3s for 0.5s' --truth truth.mcap
      tactemu run my_sensor.py:MySensor --port tcp:127.0.0.1:5000
      tactemu run anyskin --port memory: --clock virtual --seconds 10 --json
      tactemu run hand.toml --name hand --adjustable noise      # and then `tactemu poke --help`
      tactemu run hand.toml --web                               # a page to look at it, and to touch it
      tactemu run hand.toml --save pressed.npz --seconds 3      # and then --restore pressed.npz

    One line says where the port is; then a live picture, or log lines when the output is no terminal.
    Exit code 0 after Ctrl-C, SIGTERM or --seconds; 130 after Ctrl-C before the port is there; 2 when something in the
    request is wrong.
    """
    from tactemu.cli.running import Web, run_target
    from tactemu.errors import SceneError

    if virtual:
        raise SceneError("--virtual is now --clock virtual")
    run_target(
        target, options=options or (), ports=tuple(port or ()), rates=tuple(rate or ()), seed=seed, seconds=seconds,
        compute=device, faults=tuple(fault or ()), truth=truth, keep=truth_keep,
        style="json" if json else "plain" if plain else "auto", clock=clock, preempt=preempt, name=name,
        adjustable=tuple(adjustable or ()), again=again, rerun=rerun_to or rerun, restore=restore, save=save,
        save_at=save_at, web=Web(web_host, web_port) if web or web_port is not None or web_host else None,
    )  # fmt: skip


@app.command(
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []},
)
def poke(context: typer.Context) -> None:
    """Do something to a running emulator: press, move, break, look."""
    from tactemu.cli.poking import main

    main(context.args)


@app.command()
def see(
    name: Annotated[str | None, typer.Argument(help="Of the emulator; default: the only one that runs.")] = None,
    port: WebPort = None,
    host: WebHost = None,
) -> None:
    """Show what runs on a live page: bodies, taxels, curves, the wire; drag, press, unplug.

    \b
      tactemu run hand.toml               # in one terminal; or a test, `tactemu exec`, `tactemu replay`
      tactemu see                         # in another: a link for a browser on this machine
      tactemu see hand --web-port 9000
      tactemu see --web-host 0.0.0.0      # others may look and touch, who have the link

    Until Ctrl-C. When the emulator ends, the page keeps its last picture, and shows the next run of that name.
    """
    from tactemu.cli.seeing import see_emulator

    see_emulator(name, host=host, port=port)


@app.command("exec")
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
    rate: Rates = None,
    seed: Seed = None,
    device: Compute = None,
    fault: Faults = None,
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
    """Run a driver that finds the device as hardware: /dev/ttyUSB0, its USB ids, modem lines, unplugging; can0.

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
    from tactemu.cli.forwarding import forwarded_signals
    from tactemu.errors import TactemuError

    with forwarded_signals() as signals:
        from tactemu.cli.executing import run_command

        try:
            status = run_command(
                target, context.obj or (), options=options or (), nodes=tuple(node or ()), rates=tuple(rate or ()),
                seed=seed, compute=device, faults=tuple(fault or ()), truth=truth, keep=truth_keep, quiet=quiet,
                way=way, expose=tuple(expose or ()), name=name, signals=signals,
            )  # fmt: skip
        except TactemuError as error:
            typer.echo(f"tactemu: {error}", err=True)
            status = 125
    raise typer.Exit(status)


@app.command()
def judge(
    context: typer.Context,
    target: Target,
    options: Options = None,
    reads: Annotated[
        str | None,
        typer.Option(
            "--reads", metavar="MODULE:FUNCTION", help="A Python reader in place of a command, called in a loop."
        ),
    ] = None,
    port: Ports = None,
    budget: Annotated[
        str | None,
        typer.Option(metavar="T", help="How long, such as 30s or 5m; from two minutes on every byte is tried."),
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="TRIAL", help="Only trials of this name; repeatable.")
    ] = None,
    fail_on: Annotated[
        list[str] | None,
        typer.Option(
            "--fail-on",
            metavar="KIND",
            help="What fails the run, such as wrong,stale,late; all or none. Default: wrong values, stale, lost sync, "
            "died, and what cannot be judged.",
        ),
    ] = None,
    html: Annotated[Path | None, typer.Option("--html", metavar="FILE", help="Write the report as one page.")] = None,
    junit: Annotated[Path | None, typer.Option("--junit", metavar="FILE", help="Write it for a CI system.")] = None,
    json: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write it as data; a --baseline for later runs.")
    ] = None,
    baseline: Annotated[
        Path | None, typer.Option("--baseline", metavar="FILE", help="An earlier --json: only what is new fails.")
    ] = None,
    columns: Annotated[
        Path | None,
        typer.Option(
            "--columns", metavar="FILE", help="What the driver's columns hold: read, or written if not there."
        ),
    ] = None,
    cases: Annotated[
        Path | None, typer.Option("--cases", metavar="FOLDER", help="Write the smallest case of each finding here.")
    ] = None,
    replay: Annotated[Path | None, typer.Option("--replay", metavar="FILE", help="Try this case alone.")] = None,
    record: Annotated[
        Path | None, typer.Option("--record", metavar="FOLDER", help="Keep all that each trial saw, as JSON lines.")
    ] = None,
    rest: Annotated[
        float,
        typer.Option(metavar="S", min=0.0, max=600.0, help="How long the skin rests after the driver's first row."),
    ] = 1.0,
    patience: Annotated[
        float, typer.Option(metavar="S", min=0.1, max=600.0, help="How long it may take to be well again.")
    ] = 1.5,
    seed: Seed = None,
) -> None:
    """Judge a driver: what does it do when bytes are lost, the sensor restarts, the port goes?

    \b
      tactemu judge paxini_px6ax -- python my_driver.py {port}
      tactemu judge hand.toml --budget 5m --html report.html --junit report.xml -- ./reader {port}
      tactemu judge anyskin --reads mypkg.driver:read
      tactemu judge optoforce --replay cases/flipped.json -- ./reader {port}

    The driver prints a line for each reading, JSON or numbers, on its standard output. Which column holds what is
    learned from a run without faults; then each way to go wrong is tried, and every reading compared with what was
    sent.
    Exit code 0 when nothing fails, 1 when something does, 2 for a mistake in the command, 3 when there was nothing to
    judge. See docs/judge.md.
    """
    from tactemu.cli.judging import judge_driver

    status = judge_driver(
        target, context.obj or (), reads=reads, options=options or (), ports=tuple(port or ()), budget=budget,
        rest=rest, seed=seed, only=tuple(only or ()), fail_on=tuple(fail_on or ()), columns=columns, record=record,
        html=html, junit_file=junit, json_file=json, baseline=baseline, cases=cases, replay=replay, patience=patience,
    )  # fmt: skip
    raise typer.Exit(status)


@app.command()
def sweep(
    plan: Annotated[Path, typer.Argument(help="A TOML file: [[driver]] tables with name, devices, command, seeds.")],
    results: Annotated[
        Path, typer.Option("--results", metavar="FILE", help="Where the verdicts go, as Parquet; a journal beside it.")
    ] = Path("judged.parquet"),
    at_once: Annotated[
        int | None, typer.Option("--at-once", metavar="N", min=1, help="Runs side by side; default: one for each core.")
    ] = None,
    cluster: Annotated[
        str | None, typer.Option("--cluster", metavar="ADDRESS", help="A Dask scheduler, such as tcp://10.0.0.1:8786.")
    ] = None,
) -> None:
    """Judge many drivers, at many devices and seeds, here or on a cluster.

    \b
      tactemu sweep plan.toml
      tactemu sweep plan.toml --cluster tcp://10.0.0.1:8786 --results nightly.parquet

    \b
      [[driver]]
      name = "mine 1.2"
      devices = ["anyskin"]
      command = ["python", "my_driver.py", "{port}"]
      seeds = "0-9"
      options = ["--budget", "30s"]

    What is interrupted goes on where it was. Workers of a cluster should run one task at a time
    (`dask worker --nthreads 1`), and have the driver. Exit code 1 when something fails.
    """
    from tactemu.judge.sweep import read_plan
    from tactemu.judge.sweep import sweep as run_sweep

    rows = run_sweep(read_plan(plan), results, at_once=at_once, cluster=cluster, say=typer.echo)
    if any(row["fails"] for row in rows):
        raise typer.Exit(1)


@app.command()
def proxy(
    real: Annotated[
        str, typer.Argument(metavar="REAL_PORT", help="/dev/ttyUSB0, a pyserial URL, or can:INTERFACE:CHANNEL.")
    ],
    port: Annotated[
        str, typer.Option("--port", metavar="PORT", help="Where the driver comes: pty:PATH, rfc2217:HOST:PORT ...")
    ] = "pty:",
    device: Annotated[
        str | None, typer.Option("--device", metavar="NAME", help="Which sensor it is, so that frames are decoded.")
    ] = None,
    option: Annotated[
        list[str] | None, typer.Option("--option", metavar="NAME=VALUE", help="Of the device; repeatable.")
    ] = None,
    baud: Annotated[int | None, typer.Option(metavar="N", min=1, help="Speed until the driver sets one.")] = None,
    fault: Faults = None,
    truth: TruthFile = None,
    record: Annotated[
        Path | None, typer.Option("--record", metavar="FILE", help="Record what passes, for `tactemu replay`.")
    ] = None,
    seed: Seed = None,
    seconds: Seconds = None,
) -> None:
    """Sit between a real sensor and its driver: pass bytes, inject faults, write truth and a recording.

    \b
      tactemu proxy /dev/ttyACM0 --device anyskin --port pty:/tmp/skin
      tactemu proxy /dev/ttyUSB0 --device optoforce --fault 'flip 1%' --truth truth.mcap --record real.mcap
      tactemu proxy can:socketcan:can0 --port can:socketcan:vcan0 --fault 'drop 1%'

    Speed, parity and modem lines that the driver sets are passed on. Ctrl-C ends it.
    """
    from tactemu.cli.judging import run_proxy

    run_proxy(
        real, port, device=device, options=option or (), baud=baud, faults=tuple(fault or ()), truth=truth,
        record=record, seed=seed, seconds=seconds,
    )  # fmt: skip


@app.command()
def devices(
    name: Annotated[str | None, typer.Argument(help="Print this device's datasheet.")] = None,
    options: Options = None,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable.")] = False,
) -> None:
    """List the devices, or print one's datasheet.

    \b
      tactemu devices
      tactemu devices anyskin
      tactemu devices flexitac rows=16
    """
    if not name:
        from tactemu.cli.listing import print_table

        print_table(json=json)
        return
    from tactemu.cli.datasheet import options_of, print_datasheet

    print_datasheet(name, options_of(options or ()), json=json)


@app.command()
def check(
    target: Annotated[str, typer.Argument(metavar="DEVICE", help="A device's name, or path/to/device.py:Class.")],
    options: Options = None,
    fuzz: Annotated[int, typer.Option(metavar="N", min=0, help="How many spoiled requests are tried.")] = 1000,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable.")] = False,
) -> None:
    """Judge a device by its declarations, its worked examples, and by using it.

    \b
      tactemu check anyskin
      tactemu check path/to/my_sensor.py:MySensor
      tactemu check optoforce axes=6

    A line for each fault, with method, bytes, file and line; then the declared facts that no example pins.
    Exit code 0 without a fault, 1 with one, 2 when there is no such device or option.
    """
    from tactemu.cli.checking import check_device

    if not check_device(target, options or (), fuzz=fuzz, json=json).ok:
        raise typer.Exit(1)


@app.command("check-host")
def check_host(
    wanted: Annotated[
        list[str] | None, typer.Argument(metavar="[WHAT]...", help="What the exit code is about, such as can.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable.")] = False,
) -> None:
    """Say what this machine can do: ports, namespaces, CAN, GPU, how late the loop is; and what helps.

    \b
      tactemu check-host
      tactemu check-host can || sudo modprobe vcan
      tactemu check-host --json

    Everything is tried, which takes some seconds. Exit code 0 when what is named is there (default: all but vcan, the
    guest and a GPU), 1 when it is not, 2 when there is nothing of that name.
    """
    from tactemu.cli.hosting import check_host

    if not check_host(wanted or (), json=json):
        raise typer.Exit(1)


@app.command()
def explain(
    target: Annotated[str | None, typer.Argument(metavar="DEVICE_OR_SCENE")] = None,
    device: Compute = None,
    cost: Annotated[bool, typer.Option(help="Measure what each stage costs here.")] = True,
    code: Annotated[bool, typer.Option(help="Run the Python files that it names; --no-code refuses them.")] = True,
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON schema of scene files.")] = False,
) -> None:
    """Say what a scene models, and why: frames, taxels, and the plan with each stage's cost.

    \b
      tactemu explain anyskin
      tactemu explain hand.toml --device cuda:0
      tactemu explain somebodys.toml --no-code
      tactemu explain --schema > scene.schema.json
    """
    from tactemu.cli.explaining import explain_target, print_schema

    if schema:
        print_schema()
    elif target is None:
        raise typer.BadParameter("name a device or a scene file, or ask for --schema", param_hint="DEVICE_OR_SCENE")
    else:
        explain_target(target, compute=device, cost=cost, code=code)


@app.command()
def new(file: Annotated[Path, typer.Argument(help="The scene file to write, such as hand.toml.")]) -> None:
    """Write a scene file to start from: a fingertip and a ball, with comments on every key.

    \b
      tactemu new hand.toml
      tactemu run hand.toml
    """
    from tactemu.cli.starting import new_scene

    new_scene(file)


@app.command()
def examples(
    folder: Annotated[Path | None, typer.Argument(help="Copy them into this folder; it is made.")] = None,
) -> None:
    """List the examples that come with tactemu, or copy them into a folder.

    \b
      tactemu examples
      tactemu examples tactile
    """
    from tactemu.cli.starting import copy_examples, list_examples

    if folder is None:
        list_examples()
    else:
        copy_examples(folder)


@app.command()
def truth(
    file: Annotated[Path, typer.Argument(help="Written by `tactemu run --truth FILE`.")],
    json: Annotated[bool, typer.Option("--json", help="Machine-readable.")] = False,
    to: Annotated[
        str | None,
        typer.Option(
            "--to",
            metavar="FORMAT",
            help="Convert: foxglove.mcap, ros2.mcap, rrd, parquet, csv; CAN frames: log, asc, blf; its own: mcap, "
            "jsonl. Or a file's name that ends in one.",
        ),
    ] = None,
    export: Annotated[Path | None, typer.Option(metavar="FILE", hidden=True, help="As --to FILE.")] = None,
    skin: Annotated[str | None, typer.Option(metavar="NAME", help="Whose, for --to.")] = None,
    sense: Annotated[str | None, typer.Option(metavar="NAME", help="Which of its senses, for --to.")] = None,
) -> None:
    """Summarise a truth log, or convert it for other tools.

    \b
      tactemu run anyskin --seconds 10 --fault 'flip 5%' --truth truth.mcap
      tactemu truth truth.mcap
      tactemu truth truth.mcap --to foxglove.mcap
      tactemu truth truth.mcap --to thumb.csv --skin thumb
      tactemu truth truth.mcap --to bus.log

    Samples, frames, drops and injected faults of each device; --to writes a file beside the log, or the one named.
    """
    from tactemu.cli.truths import convert_log, print_summary

    if to is None and export is None:
        print_summary(file, json=json)
    else:
        convert_log(file, to or str(export), skin=skin, sense=sense)


@app.command()
def licences(json: Annotated[bool, typer.Option("--json", help="Machine-readable.")] = False) -> None:
    """List tactemu and what is installed because of it: package, version, licence, needed by.

    \b
      tactemu licences
      tactemu licences --json
    """
    from tactemu.cli.licences import print_licences

    print_licences(json=json)


@app.command()
def plot(
    file: Annotated[Path, typer.Argument(help="A truth log.")],
    to: Annotated[
        Path | None,
        typer.Option("--to", metavar="FILE", help="What to write: .png, .svg or .html; default: beside it."),
    ] = None,
    skin: Annotated[str | None, typer.Option(metavar="NAME", help="Which skin; default: the first.")] = None,
    sense: Annotated[str | None, typer.Option(metavar="NAME", help="Which of its senses; default: the first.")] = None,
) -> None:
    """Draw a truth log: curves, contact patch, hysteresis, time to the wire, spectrum.

    \b
      tactemu run anyskin --clock virtual --port memory: --seconds 10 --truth truth.mcap
      tactemu plot truth.mcap
      tactemu plot truth.mcap --to thumb.png --skin thumb
    """
    from tactemu.cli.truths import plot_log

    plot_log(file, to or file.with_suffix(".html"), skin=skin, sense=sense)


@app.command()
def faults() -> None:
    """List what can go wrong on a wire, with the words for `run --fault` and for scene files.

    \b
      tactemu faults
      tactemu run anyskin --fault 'drop 1%' --fault 'unplug at 3s for 0.5s'
      tactemu run linker_hand_l6 --fault 'flip 5% id=0x28 from 2s to 6s'
    """
    from tactemu.cli.recordings import print_faults

    print_faults()


@app.command()
def record(
    file: Annotated[Path, typer.Argument(help="What to write: .mcap or .jsonl; for CAN also .log, .asc or .blf.")],
    source: Annotated[
        str, typer.Option("--from", metavar="SOURCE", help="/dev/ttyUSB0, a pyserial URL, or can:INTERFACE:CHANNEL.")
    ],
    baud: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Speed of a serial port [bit/s]; default: 115200.")
    ] = None,
    seconds: Seconds = None,
) -> None:
    """Record what a sensor sends, with its timing, until Ctrl-C.

    \b
      tactemu record anyskin.mcap --from /dev/ttyACM0
      tactemu record hand.log --from can:socketcan:can0 --seconds 10
    """
    from tactemu.cli.recordings import record_stream

    record_stream(source, file, baud=baud, seconds=seconds)


@app.command()
def replay(
    file: Annotated[Path, typer.Argument(help="A recording, or a truth log.")],
    port: Annotated[
        str, typer.Option("--port", metavar="PORT", help="pty:PATH, can:INTERFACE:CHANNEL, tcp:HOST:PORT ...")
    ],
    skin: Annotated[
        str | None, typer.Option(metavar="NAME", help="Whose frames, where a truth log has several skins.")
    ] = None,
    speed: Annotated[float, typer.Option(metavar="X", help="2 is twice as fast; inf as fast as it goes.")] = 1.0,
    step: Annotated[bool, typer.Option("--step", help="Send one frame for every line on stdin.")] = False,
    loop: Annotated[bool, typer.Option("--loop", help="Start again at the end.")] = False,
    fault: Faults = None,
    seconds: Seconds = None,
    name: RunName = None,
) -> None:
    """Play a recording to a driver. A serial one starts when the driver opens the port.

    \b
      tactemu replay anyskin.mcap --port pty:/tmp/skin --speed 2
      tactemu replay hand.blf --port can:socketcan:vcan0 --fault 'drop 1%'
      tactemu replay truth.mcap --port pty:/tmp/skin --skin thumb --step
    """
    from tactemu.cli.recordings import replay_file

    replay_file(
        file, port, skin=skin, speed=speed, step=step, loop=loop, faults=tuple(fault or ()), seconds=seconds,
        name=name,
    )  # fmt: skip


@app.command("fit")
def fit_recordings(
    recordings: Annotated[
        list[Path], typer.Argument(metavar="RECORDING...", help=".csv, .csv.gz, .npz, .parquet, .mcap or .jsonl.")
    ],
    device: Annotated[str, typer.Option("--device", metavar="DEVICE", help="What was recorded; `tactemu devices`.")],
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Scene file to write.")],
    columns: Annotated[
        str | None,
        typer.Option(metavar="ROLE=COLUMNS,...", help="t=t_s,z=z_mm,field=b0x:b4z; default: by their names."),
    ] = None,
    unit: Annotated[
        list[str] | None,
        typer.Option("--unit", metavar="ROLE=UNIT,...", help="z=mm,field=uT; default: SI; repeatable."),
    ] = None,
    rate: Annotated[
        float | None, typer.Option(metavar="HZ", min=0.001, max=1e6, help="Of the rows, where they have no times.")
    ] = None,
    report: Annotated[Path | None, typer.Option(metavar="FILE", help="Report (HTML); default: beside --out.")] = None,
) -> None:
    """Find a sensor's parameters in recordings of it, and write a scene file of it.

    \b
      tactemu fit rest.csv --device anyskin --columns t=t_s,field=b0x:b4z --unit field=uT --out my_skin.toml
      tactemu fit a.csv b.csv --device anyskin --columns t=t_s,force=f,field=b0x:b4z --unit field=uT --out my_skin.toml

    Roles: t, z, depth, force, mass, temperature, untouched, and what it reads: field, counts, pressure, resistance,
    capacitance or reading. What a recording does not tell is said, with what to record next. Needs scipy.
    """
    from tactemu.cli.progress import show_progress
    from tactemu.fit.fitting import run_fit

    page = report or out.with_suffix(".html")
    run_fit(
        recordings, device=device, out=out, report=page, columns=_pairs("--columns", columns),
        units=_pairs("--unit", ",".join(unit) if unit else None), rate_hz=rate, say=typer.echo, progress=show_progress,
    )  # fmt: skip


def _pairs(option: str, text: str | None) -> dict[str, str] | None:
    """``a=b,c=d`` as a table."""
    from tactemu.errors import TactemuError

    if text is None:
        return None
    found = {}
    for part in text.split(","):
        name, mark, value = part.partition("=")
        if not (mark and name.strip() and value.strip()):
            raise TactemuError(f"{option}: expected NAME=VALUE, several with commas, got {part!r}")
        found[name.strip()] = value.strip()
    return found


@app.command()
def tune(
    target: Target,
    rate: Annotated[float, typer.Option("--rate", metavar="HZ", help="Samples per second that every skin shall keep.")],
    error: Annotated[str, typer.Option(metavar="METRIC", help="taxels, total or worst.")] = "taxels",
    seconds: Annotated[
        float, typer.Option(metavar="S", min=0.01, max=1000, help="How much of the scene is looked at.")
    ] = 4.0,
    write: Annotated[bool, typer.Option(help="Write the choice into the scene file.")] = True,
    device: Compute = None,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable.")] = False,
) -> None:
    """Choose the most accurate sensor model and dials that keep a rate on this machine.

    \b
      tactemu tune hand.toml --rate 500
      tactemu tune anyskin --rate 100 --error total

    Measures every setting on the scene, says what it costs and how wrong it is, and writes the choice into the file.
    """
    from tactemu.cli.progress import show_progress
    from tactemu.kernels import start_quietly
    from tactemu.tune.choice import as_dict
    from tactemu.tune.tuner import run_tune

    start_quietly()
    say = (lambda _text: None) if json else typer.echo
    choices = run_tune(
        target, rate, error=error, report=say, seconds=seconds, write=write, compute=device, progress=show_progress
    )
    if json:
        import json as encoder

        typer.echo(encoder.dumps([as_dict(choice) for choice in choices], indent=1))
