"""Commands that test drivers: judge, sweep and proxy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactemu.cli.parameters import Faults, Options, Ports, Seconds, Seed, Target, TruthFile, quantity_of
from tactemu.cli.sections import in_sections
from tactemu.cli.words import options_of, ports_of, typed_command

commands = typer.Typer(rich_markup_mode=None)


@commands.command(
    cls=in_sections({
        "Driver": "reads port columns no_contact patience",
        "Trials": "budget only replay seed success",
        "Reports": "fail_on html junit json baseline cases record",
    })
)  # fmt: skip
def judge(
    context: typer.Context,
    target: Target,
    options: Options = None,
    reads: Annotated[
        str | None,
        typer.Option(
            "--reads", metavar="MODULE:FUNCTION", help="Python function to call in a loop instead of a command."
        ),
    ] = None,
    port: Ports = None,
    budget: Annotated[
        float | None,
        typer.Option(
            metavar="T",
            parser=quantity_of("--budget", low=1e-3),
            help="Time for all trials, such as 30s or 5m; with 2m or more every byte is tried.",
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only", metavar="TRIALS", help="Run only trials of these names, such as flipped,hang; repeatable."
        ),
    ] = None,
    fail_on: Annotated[
        list[str] | None,
        typer.Option(
            "--fail-on",
            metavar="KIND",
            help="Findings that fail the run, such as wrong,stale,late; all or none. Default: silent wrong values, "
            "stale, lost sync, died, prints nothing, clipped or flat, floods, cannot be told.",
        ),
    ] = None,
    html: Annotated[Path | None, typer.Option("--html", metavar="FILE", help="Write the report as one page.")] = None,
    junit: Annotated[
        Path | None, typer.Option("--junit", metavar="FILE", help="Write the report for a CI system.")
    ] = None,
    json: Annotated[
        Path | None,
        typer.Option("--json", metavar="FILE", help="Write the report as JSON, for --baseline of later runs."),
    ] = None,
    baseline: Annotated[
        Path | None, typer.Option("--baseline", metavar="FILE", help="An earlier --json: only new findings fail.")
    ] = None,
    columns: Annotated[
        Path | None,
        typer.Option(
            "--columns", metavar="FILE", help="Meaning of the driver's columns: read, or written if it does not exist."
        ),
    ] = None,
    cases: Annotated[
        Path | None, typer.Option("--cases", metavar="FOLDER", help="Write the smallest case of each finding here.")
    ] = None,
    replay: Annotated[Path | None, typer.Option("--replay", metavar="FILE", help="Run this case only.")] = None,
    record: Annotated[
        Path | None,
        typer.Option("--record", metavar="FOLDER", help="Write the record of each trial here, as JSON lines."),
    ] = None,
    no_contact: Annotated[
        float,
        typer.Option(
            "--rest",
            metavar="S",
            parser=quantity_of("--rest", high=600.0),
            help="Time without touch after the driver's first row.",
        ),
    ] = 1.0,
    patience: Annotated[
        float,
        typer.Option(
            metavar="S",
            parser=quantity_of("--patience", low=0.1, high=600.0),
            help="Time in which the driver must recover from a fault.",
        ),
    ] = 1.5,
    seed: Seed = None,
    success: Annotated[
        Path | None,
        typer.Option(
            "--success", metavar="SCRIPT", help="Judge a complete task: success(dev) of this script returns the result."
        ),
    ] = None,
) -> None:
    """Test a driver against faults on the wire.

    Bytes are lost or damaged, the sensor restarts, the port disappears, and more.

    \b
      tactemu judge paxini_px6ax -- python my_driver.py {port}
      tactemu judge hand.toml --budget 5m --html report.html -- ./reader {port}
      tactemu judge anyskin --reads mypkg.driver:read
      tactemu judge optoforce --replay cases/flipped.json -- ./reader {port}
      tactemu judge hand.toml --success held.py -- python grasp.py {port}

    Your driver must print a line for each reading, JSON or numbers, on its standard output. A run without faults shows
    the meaning of its columns; then each fault is tried, and every reading is compared with the sent values.
    With --success the output of the command is not read: lost, damaged and late frames and dead taxels (--only drop,
    flip, late, dead) increase, and the result is the success rate; you can add --port, --budget, --seed and
    --json.
    Exit code 0 if nothing fails, 1 if something fails, 2 for an error in the command or a driver that ends before it
    reads anything, 3 if there was nothing to judge.
    See docs/judge.md.
    """
    from tactemu.cli.judge_output import (
        ReportFiles,
        judge_driver,
        judge_success,
        kinds_of,
        reading_or_program,
        words_of,
    )
    from tactemu.judge.options import JudgeOptions

    chosen = JudgeOptions(
        no_contact_s=no_contact, seed=seed or 0, budget_s=budget, only=words_of(only or ()), columns=columns,
        fail_on=kinds_of(fail_on or ()), record=record, device_options=options_of(options or ()),
        port=ports_of(port or ()), patience_s=patience,
    )  # fmt: skip
    if success is not None:
        raise typer.Exit(judge_success(target, context.obj or (), success, chosen, json))
    command = reading_or_program(target, context.obj or (), reads, chosen.port)
    files = ReportFiles(
        html=html, junit=junit, json=json, baseline=baseline, cases=cases, replay=replay, command=typed_command()
    )
    raise typer.Exit(judge_driver(target, command, chosen, files))


@commands.command()
def sweep(
    plan: Annotated[
        Path, typer.Argument(metavar="PLAN", help="A TOML file: [[driver]] tables with name, devices, command, seeds.")
    ],
    results: Annotated[
        Path, typer.Option("--results", metavar="FILE", help="Parquet file for the verdicts; a journal is beside it.")
    ] = Path("judged.parquet"),
    at_once: Annotated[
        int | None,
        typer.Option("--at-once", metavar="N", min=1, help="Number of parallel runs; default: one for each core."),
    ] = None,
    cluster: Annotated[
        str | None, typer.Option("--cluster", metavar="ADDRESS", help="A Dask scheduler, such as tcp://10.0.0.1:8786.")
    ] = None,
) -> None:
    """Test many drivers, here or on a cluster.

    Each driver is judged with many devices and seeds.

    \b
      tactemu sweep plan.toml
      tactemu sweep plan.toml --cluster tcp://10.0.0.1:8786 --results out.parquet

    \b
      [[driver]]
      name = "mine 1.2"
      devices = ["anyskin"]
      command = ["python", "my_driver.py", "{port}"]
      seeds = "0-9"
      options = ["--budget", "30s"]

    The same command continues an interrupted sweep. Workers of a cluster should run one task at a time
    (`dask worker --nthreads 1`), and have the driver installed. Exit code 1 if something fails.
    """
    from tactemu.judge.sweep import read_plan
    from tactemu.judge.sweep import sweep as run_sweep

    rows = run_sweep(read_plan(plan), results, at_once=at_once, cluster=cluster, report_progress=typer.echo)
    if any(row["fails"] for row in rows):
        raise typer.Exit(1)


@commands.command(
    cls=in_sections({
        "Ports": "port baud",
        "Sensor and faults": "sensor option fault seed",
        "Logs": "truth record",
    })
)  # fmt: skip
def proxy(
    real: Annotated[
        str,
        typer.Argument(metavar="REAL_PORT", help="The sensor: /dev/ttyUSB0, a pyserial URL, or can:INTERFACE:CHANNEL."),
    ],
    port: Annotated[
        str, typer.Option("--port", metavar="PORT", help="Port for the driver: pty:PATH, rfc2217:HOST:PORT ...")
    ] = "pty:",
    sensor: Annotated[
        str | None,
        typer.Option("--sensor", metavar="NAME", help="The sensor's name in `tactemu devices`, to decode it."),
    ] = None,
    option: Annotated[
        list[str] | None, typer.Option("--option", metavar="NAME=VALUE", help="Option of the sensor; repeatable.")
    ] = None,
    baud: Annotated[int | None, typer.Option(metavar="N", min=1, help="Baud rate until the driver sets one.")] = None,
    fault: Faults = None,
    truth: TruthFile = None,
    record: Annotated[
        Path | None, typer.Option("--record", metavar="FILE", help="Record the bytes or frames, for `tactemu replay`.")
    ] = None,
    seed: Seed = None,
    seconds: Seconds = None,
) -> None:
    """Inject faults between a real sensor and its driver.

    It passes bytes on, and can write a truth log and a recording.

    \b
      tactemu proxy /dev/ttyACM0 --sensor anyskin --port pty:/tmp/skin
      tactemu proxy /dev/ttyUSB0 --sensor optoforce --record real.mcap
      tactemu proxy can:socketcan:can0 --port can:socketcan:can1 --fault 'drop 1%'

    Baud rate, parity and modem lines that the driver sets are passed on, too. Ctrl-C ends it.
    """
    from contextlib import ExitStack

    from firmware_protocols import Serial
    from tactemu.cli.signals import ended_by_signals
    from tactemu.emulator.replay import DEFAULT_BAUD, line_note
    from tactemu.judge.proxy import Proxy, RealBus, RealSerial
    from tactemu.scene.building import make_device
    from tactemu.truth import Truth
    from tactemu.truth.recorder import Recorder

    model = make_device(sensor, options_of(option or ())) if sensor else None
    own = next((each.baud for each in model.ports if isinstance(each, Serial)), None) if model else None
    with ExitStack() as stack:
        side = RealBus(real) if real.startswith("can:") else RealSerial(real, baud or own or DEFAULT_BAUD)
        stack.callback(side.close)
        recorder = stack.enter_context(Recorder(record, line=line_note(real, baud))) if record is not None else None
        log = Truth(truth) if truth is not None else Truth()
        passing = Proxy(model, side, port, fault or (), seed or 0, log, recorder, sensor or "sensor")
        stack.enter_context(ended_by_signals(passing.stop))

        def opened(address: str) -> None:
            typer.echo(f"{real} is passed on to {address}")
            typer.echo(f"  {passing.framing.about if sensor else 'undecoded: no --sensor'}")

        passing.run(seconds, opened)
    injected = ", ".join(f"{kind} {n}" for kind, n in log.injected.items()) or "nothing"
    passed = ", ".join(f"{n} {way}" for way, n in passing.passed.items())
    typer.echo(f"passed: {passed}; samples decoded: {passing.samples}; injected: {injected}")
