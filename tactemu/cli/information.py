"""Commands that print information: devices, check, check-host and faults."""

from __future__ import annotations

from typing import Annotated

import typer

from tactemu.cli.fitting import print_fitted
from tactemu.cli.parameters import Options

commands = typer.Typer(rich_markup_mode=None)


@commands.command()
def devices(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="The device whose datasheet is printed.")] = None,
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
    from tactemu.cli.datasheet import print_datasheet
    from tactemu.cli.words import options_of

    print_datasheet(name, options_of(options or ()), json=json)


@commands.command()
def check(
    target: Annotated[str, typer.Argument(metavar="DEVICE", help="A device's name, or path/to/device.py:Class.")],
    options: Options = None,
    fuzz: Annotated[int, typer.Option(metavar="N", min=0, help="Number of corrupted requests to try.")] = 1000,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable.")] = False,
) -> None:
    """Check a device file of your own.

    It checks the declarations and the worked examples, and uses the device.

    \b
      tactemu check anyskin
      tactemu check path/to/my_sensor.py:MySensor
      tactemu check optoforce axes=6

    It prints a line for each error with method, bytes, file and line; then the declared facts that no example covers.
    Exit code 0 without an error, 1 with one, 2 if there is no such device or option.
    """
    import json as json_module

    from firmware_protocols.check import check as check_contract
    from firmware_protocols.options import from_words
    from tactemu.base.errors import DeviceError
    from tactemu.cli.progress import show_parts

    try:
        with show_parts() as progress:
            report = check_contract(target, from_words(options or ()), fuzz=fuzz, progress=progress)
    except (LookupError, ValueError) as error:
        raise DeviceError(str(error)) from None
    if json:
        typer.echo(json_module.dumps(report.as_dict()))
    else:
        print_fitted(*report.lines())
    if not report.ok:
        raise typer.Exit(1)


@commands.command("check-host")
def check_host(
    wanted: Annotated[
        list[str] | None, typer.Argument(metavar="WHAT", help="The checks that decide the exit code, such as can.")
    ] = None,
    port: Annotated[
        str | None,
        typer.Option("--port", help="Check this serial port or CAN interface instead, such as serial:ttyUSB0."),
    ] = None,
    loopback: Annotated[bool, typer.Option("--loopback", help="TX and RX of the port are joined: measure it.")] = False,
    baud: Annotated[int, typer.Option("--baud", metavar="N", help="The speed for --loopback [bit/s].")] = 115_200,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable.")] = False,
) -> None:
    """Check what this machine can do, and how to improve it.

    The checks cover ports, namespaces, CAN, GPU, and time: the lateness of a loop at 1 kHz, the rate that this machine
    holds now, and what makes samples late (busy programs, a container's limit, the governor, deep idle states), each
    with the command that helps. With --port they tell what the hardware behind a port is and holds: its driver and ids,
    speeds, latency, errors and, with TX joined to RX, its rate and jitter.

    \b
      tactemu check-host
      tactemu check-host loop neighbours || echo 'samples will be late'
      tactemu check-host can || sudo modprobe vcan
      tactemu check-host --port serial:/dev/ttyUSB0 --loopback
      tactemu check-host --port can:socketcan:can0 --json

    Everything is tried without privileges, which takes less than ten seconds; nothing is changed. Exit code 0 if the
    named checks pass (default: ports, view, preload, can and loop), 1 if one does not, 2 if there is no check of that
    name.
    """
    from tactemu.cli.check_host import check_host
    from tactemu.cli.finding import tell

    if port is None and not loopback:
        passed = check_host(wanted or (), json=json)
    elif port is None or wanted:
        raise typer.BadParameter("--loopback needs a --port; a --port has checks of its own")
    else:
        from tactemu.cli.check_port import check_port

        passed = all(each.there for each in tell(check_port(port, loopback=loopback, baud=baud), json=json))
    if not passed:
        raise typer.Exit(1)


@commands.command()
def faults() -> None:
    """List the faults that can be injected on a wire.

    The list has the words for `run --fault` and for scene files.

    \b
      tactemu faults
      tactemu run anyskin --fault 'drop 1%' --fault 'unplug at 3s for 0.5s'
      tactemu run linker_hand_l6 --fault 'flip 5% id=0x28 from 2s to 6s'
    """
    from tactemu.wire.faults import DIRECTIONS, FAULTS
    from tactemu.wire.line_models import kinds_with, modelled_for

    width = max(map(len, FAULTS))
    lines = []
    for word, fault in FAULTS.items():
        options = "".join(f" [{option}]" for option in fault.own_options())
        on = [] if fault.every_line else [f"{', '.join(kinds_with(word))} only"]
        on += [f"no real {kind} line" for kind in modelled_for(word)]
        where = f" ({'; '.join(on)})" if on else ""
        lines.append(f"  {word:{width}}  {fault.about}{where}{options}")
    lines += ["", f"KIND [N% | every N | frame N,N-N] [id=0x201] [prefix=55aa] [{' | '.join(DIRECTIONS)}]"]
    lines += ["     [at T [for T] | from T] [to T]"]
    lines += ["Times are 3s, 16ms or 200us of emulation time; N% is per frame, or the share of the bus (load, babble)."]
    lines += ["Frames are counted from 1, bytes from 0 or, negative, from the end, bits from the lowest, 0."]
    print_fitted(*lines)
