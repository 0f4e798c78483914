"""Commands that say what there is: devices, this machine, faults, licences."""

from __future__ import annotations

from typing import Annotated

import typer

from tactemu.cli.parameters import Options

commands = typer.Typer(rich_markup_mode=None)


@commands.command()
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


@commands.command()
def check(
    target: Annotated[str, typer.Argument(metavar="DEVICE", help="A device's name, or path/to/device.py:Class.")],
    options: Options = None,
    fuzz: Annotated[int, typer.Option(metavar="N", min=0, help="How many spoiled requests are tried.")] = 1000,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable.")] = False,
) -> None:
    """Check a device file of your own.

    By its declarations, its worked examples, and by using it.

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


@commands.command("check-host")
def check_host(
    wanted: Annotated[
        list[str] | None, typer.Argument(metavar="[WHAT]...", help="What the exit code is about, such as can.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable.")] = False,
) -> None:
    """Say what this machine can do, and what helps.

    Ports, namespaces, CAN, GPU, how late the loop is.

    \b
      tactemu check-host
      tactemu check-host can || sudo modprobe vcan
      tactemu check-host --json

    Everything is tried, which takes some seconds. Exit code 0 when what is named is there (default: all but vcan, the
    guest and a GPU), 1 when it is not, 2 when there is nothing of that name.
    """
    from tactemu.cli.check_host import check_host

    if not check_host(wanted or (), json=json):
        raise typer.Exit(1)


@commands.command()
def faults() -> None:
    """List what can go wrong on a wire.

    With the words for `run --fault` and for scene files.

    \b
      tactemu faults
      tactemu run anyskin --fault 'drop 1%' --fault 'unplug at 3s for 0.5s'
      tactemu run linker_hand_l6 --fault 'flip 5% id=0x28 from 2s to 6s'
    """
    from tactemu.cli.recordings import print_faults

    print_faults()


@commands.command()
def licences(json: Annotated[bool, typer.Option("--json", help="Machine-readable.")] = False) -> None:
    """List the licences of tactemu and its dependencies.

    Package, version, licence, and what needs it.

    \b
      tactemu licences
      tactemu licences --json
    """
    from tactemu.cli.licences import print_licences

    print_licences(json=json)
