"""The command that attaches USB devices of a server to this machine: attach."""

from __future__ import annotations

from typing import Annotated

import typer

commands = typer.Typer()


@commands.command()
def attach(
    server: Annotated[str, typer.Argument(metavar="HOST[:PORT]", help="Where `--port usbip:` listens.")] = "127.0.0.1",
    busid: Annotated[
        list[str] | None, typer.Argument(metavar="BUSID", help="Devices, such as 1-1. Default: all.")
    ] = None,
    names_only: Annotated[bool, typer.Option("--list", help="List the devices and end.")] = False,
) -> None:
    """Plug emulated USB devices into this machine.

    Needs root, and the kernel module vhci-hcd. A device that is unplugged is attached again when it is back. Ctrl-C
    detaches all.

    \b
    Examples:
      tactemu run robotiq_tsf85 --port usbip:
      tactemu attach --list
      sudo $(which tactemu) attach
      sudo $(which tactemu) attach 192.168.7.2 1-1
    """
    import signal

    from tactemu.base.errors import TactemuError, no_such
    from tactemu.transports import inet
    from tactemu.transports.usb import vhci
    from tactemu.transports.usbip import USUAL_PORT

    host, port = inet.parse("usbip", server if ":" in server else f"{server}:{USUAL_PORT}")
    devices = vhci.listed(host, port)
    if names_only:
        for each in devices:
            typer.echo(f"{each.busid}  {each.vid:04x}:{each.pid:04x}")
        return
    there = [each.busid for each in devices]
    if missing := [each for each in busid or () if each not in there]:
        raise TactemuError(f"{server} has {no_such('device', missing[0], there)}")
    if not there:
        raise TactemuError(f"{server} offers no device")
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the kernel would keep the devices
    try:
        for event in vhci.keep_attached(host, port, busid or there):
            typer.echo(event)
    except KeyboardInterrupt:
        pass
