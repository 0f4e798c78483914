"""The command that makes a board the sensor at the end of a USB cable: gadget."""

from __future__ import annotations

import os
import shlex
import sys
from typing import Annotated

import typer

from firmware_protocols import Connector
from tactemu.base.errors import TactemuError

commands = typer.Typer()

MISSING = "no USB device controller; on a Raspberry Pi: dtoverlay=dwc2,dr_mode=peripheral in config.txt, then restart"


@commands.command(context_settings={"ignore_unknown_options": True})
def gadget(
    arguments: Annotated[list[str], typer.Argument(metavar="DEVICE [OPTION]...", help="As for `tactemu run`.")],
    controller: Annotated[
        str | None, typer.Option("--udc", help="The controller, from /sys/class/udc. Default: the first one.")
    ] = None,
    name: Annotated[str, typer.Option("--gadget", help="The name of the gadget in configfs.")] = "tactemu",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the steps as a shell script, and end.")] = False,
) -> None:
    """Be the sensor on this board's USB device port, until Ctrl-C.

    For boards with a USB device controller, such as a Raspberry Pi or BeagleBone: the computer at the other end of the
    cable sees the sensor's USB device. Needs root. Prints each step, and undoes them all at the end.

    \b
    Examples:
      tactemu gadget anyskin --dry-run
      sudo $(which tactemu) gadget anyskin
      sudo $(which tactemu) gadget seed_fts3 --udc fe980000.usb --plain
    """
    from tactemu.scene.building import make_device

    if any(each == "--port" or each.startswith("--port=") for each in arguments):
        raise TactemuError("tactemu gadget gives the device its port; leave out --port")
    text = script(make_device(arguments[0], {}).ports[0], arguments, controller=controller or "", name=name)
    if dry_run:
        typer.echo(text, nl=False)
        return
    if os.geteuid() != 0:
        raise TactemuError("a gadget is made by root: sudo $(which tactemu) gadget ...; --dry-run prints the steps")
    os.execvp("sh", ["sh", "-xc", text])  # the shell prints each step, and undoes them when it is told to end


def script(connector: Connector, arguments: list[str], *, controller: str, name: str) -> str:
    """Return a shell script that makes a gadget, runs the device on it, and removes it at the end.

    Raises:
        TransportError: the device has no USB port.
    """
    from tactemu.transports.usb.devices import device_of
    from tactemu.transports.usb.serial_chips import CdcAcm

    device, _ = device_of(connector, f"gadget:{name}")
    is_acm = isinstance(device, CdcAcm)
    own = device.descriptors()
    identity = {
        "idVendor": f"{own.vid:#06x}", "idProduct": f"{own.pid:#06x}", "bcdDevice": f"{own.release:#06x}",
        "bcdUSB": f"{own.usb:#06x}", "bDeviceClass": f"{own.code[0]:#04x}", "bDeviceSubClass": f"{own.code[1]:#04x}",
        "bDeviceProtocol": f"{own.code[2]:#04x}",
    }  # fmt: skip
    names = dict(zip(("manufacturer", "product", "serialnumber"), own.strings))
    names = {key: text for key, text in names.items() if text}
    function = f"acm.{name}" if is_acm else f"ffs.{name}"
    # The port of the kernel's own function is there before the device has been given to the controller.
    port = 'serial:/dev/ttyGS$(cat "functions/$function/port_num")' if is_acm else f"gadget:{name}:$controller"
    run = shlex.join([sys.executable, "-m", "tactemu", "run", *arguments])
    lines = [
        "#!/bin/sh", f"# {shlex.join(['tactemu', 'gadget', *arguments])}: made on this board, and removed at the end.",
        "set -e",
        f"controller={shlex.quote(controller)}",
        '[ -n "$controller" ] || controller=$(ls /sys/class/udc 2>/dev/null | head -n 1)',
        f'[ -n "$controller" ] || {{ echo {shlex.quote(MISSING)} >&2; exit 1; }}',
        f"gadget=/sys/kernel/config/usb_gadget/{name} function={function} folder=$PWD child=",
        *_undo(is_acm, name),
        f"modprobe -a libcomposite {'usb_f_acm' if is_acm else 'usb_f_fs'} || :  # they may be part of the kernel",
        "mountpoint -q /sys/kernel/config || mount -t configfs none /sys/kernel/config",
        'mkdir "$gadget"',
        'cd "$gadget"',
        'trap undo EXIT', "trap 'exit 130' INT", "trap 'exit 143' TERM HUP",
        *(f"echo {value} >{key}" for key, value in identity.items()),
        "[ ! -e max_speed ] || echo full-speed >max_speed  # as the chip",
        "mkdir strings/0x409", *(f"echo {shlex.quote(text)} >strings/0x409/{key}" for key, text in names.items()),
        "mkdir configs/c.1", f"echo {0x80 | own.attributes:#04x} >configs/c.1/bmAttributes",
        f"echo {own.power_ma} >configs/c.1/MaxPower",
        'mkdir "functions/$function"', 'ln -s "functions/$function" configs/c.1/',
    ]  # fmt: skip
    if is_acm:
        lines.append('echo "$controller" >UDC')
    else:
        lines += [f"mkdir -p /dev/ffs-{name}", f"mount -t functionfs {name} /dev/ffs-{name}"]
    lines += [f"port={port}", 'cd "$folder"', f'{run} --port "$port" &', "child=$!", 'wait "$child"', ""]
    return "\n".join(lines)


def _undo(is_acm: bool, name: str) -> list[str]:
    """Return the function that removes the gadget, in the order that configfs wants."""
    unmount = [] if is_acm else [f"  umount /dev/ffs-{name} && rmdir /dev/ffs-{name}"]
    return [
        "undo() {", "  trap - EXIT INT TERM HUP", "  set +e",
        '  [ -z "$child" ] || { kill "$child"; wait "$child"; } 2>/dev/null',
        '  cd "$gadget" && [ -z "$(cat UDC)" ] || echo >UDC', *unmount,
        '  rm -f "configs/c.1/$function"', "  rmdir configs/c.1 functions/* strings/0x409", '  cd / && rmdir "$gadget"',
        "}",
    ]  # fmt: skip
