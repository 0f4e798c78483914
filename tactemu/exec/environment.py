"""Emulators in a view of the machine, and commands that run in it.

::

    with tactemu.serve("robotiq_tsf85") as dev, tactemu.exec_environment(dev) as env:
        subprocess.run(env.command(["python", "quick_start.py"]), check=True)
        env.run(["./reader", "--port", env.nodes["robotiq_tsf85"]])
"""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, replace
from typing import Any
from urllib.parse import urlsplit

from firmware_protocols import USB, Can, Device, Serial
from tactemu.base.errors import TransportError
from tactemu.exec.build import NoLibrary, library
from tactemu.exec.bus import WAYS, BusPort
from tactemu.exec.expose import Exposed, parsed
from tactemu.exec.keeping import Keeper
from tactemu.exec.port import Node, UsbPort
from tactemu.exec.uart import CHIPS
from tactemu.session.serving import Served
from tactemu.transports import Transport
from tactemu.transports.socketcan import SocketCanTransport
from tactemu.wire.wire import Wire

_NODE = re.compile(rf"(?:/dev/)?(ttyUSB|ttyACM|can|{'|'.join(CHIPS)})(\d{{1,3}})")
_ADAPTER = USB(0x0403, 0x6001, manufacturer="FTDI", product="FT232R USB UART", node="ttyUSB")
"""What a board with a plain UART is plugged into."""
_BOARD = USB(0x1209, 0x0001, manufacturer="tactemu", node="ttyACM")
"""A board with USB whose ids are not declared: pid.codes' number for tests."""


def exec_environment(
    *devices: Served, nodes: str | Mapping[str, str] = "", way: str = "", expose: Sequence[str] = ()
) -> ExecEnvironment:
    """Return a view of this machine in which the ports of ``devices`` are serial ports and CAN interfaces.

    Devices that are not running are started, and stopped at the end; those that are get their former ports back.

    Args:
        devices: what :func:`tactemu.serve` returns.
        nodes: ``ttyUSB0`` for the only port, or nodes by skin or ``SKIN/CONNECTOR``; default: as the kernel would name
            them, ``ttyACM0`` or ``ttyUSB0`` upwards; ``can0`` upwards. ``ttyS0``, ``ttyAMA0``, ``ttyTHS1`` and so on
            are UARTs of the board itself.
        expose: ``tcp:PORT``, ports that are carried between the machine's network and that of a view with CAN buses.
        way: how CAN buses are made, ``native`` (vcan) or ``preload``; default: whichever this kernel offers.

    Raises:
        TactemuError: this machine allows no such view (the message says why, and what helps); no such skin or node.
    """
    return ExecEnvironment(devices, nodes, way, expose)


class ExecEnvironment:
    """What :func:`exec_environment` returns."""

    def __init__(
        self,
        devices: Sequence[Served],
        nodes: str | Mapping[str, str] = "",
        way: str = "",
        expose: Sequence[str] = (),
    ):
        self.devices = tuple(devices)
        """Those that are plugged in, to press and to spoil."""
        self._wishes = _nodes_in({"": nodes} if isinstance(nodes, str) and nodes else dict(nodes or {}))
        self._keeper: Keeper | None = None
        self._undo = ExitStack()
        self._sockets: dict[tuple[Any, ...], int] = {}
        """Number of the socket that each USB device is in."""
        self._ports: dict[str, UsbPort | BusPort] = {}
        self._on_network: dict[str, Transport] = {}
        """Ports that a program reaches by an address, by their titles."""
        self._buses: set[str] = set()
        """Names of the CAN interfaces."""
        if way not in ("", *WAYS):
            raise TransportError(f"way {way!r}: expected {' or '.join(WAYS)}")
        self._way = way
        self._expose = [parsed(text) for text in expose]
        self._exposed: list[Exposed] = []
        self.missing = ""
        """Why there is no preload library; empty when there is one."""

    # -- life ----------------------------------------------------------------------------------------------------------

    def start(self) -> ExecEnvironment:
        """Make the view and plug everything in.

        Raises:
            TactemuError: it cannot be made; nothing is left behind.
        """
        with ExitStack() as undo:
            try:
                preload = str(library())
            except NoLibrary as error:
                preload, self.missing = "", str(error)
            self._keeper = Keeper(preload)
            undo.callback(self._keeper.close)
            keep = [dev for dev in self.devices if dev.running]
            for dev in self.devices:
                if dev not in keep:
                    dev.before_opening = self._put_on_buses
                    undo.enter_context(dev)
            self._keeper.wait()
            plugs = [plug for dev in self.devices for plug in self._plugs_of(dev)]
            if self._wishes:
                known = ", ".join(self._ports) or "none"
                known += "".join(f"; {title} is at {port.address}" for title, port in self._on_network.items())
                raise TransportError(f"no such port: {', '.join(self._wishes)} (there are: {known})")
            self._check_network()
            for dev, wire, port in sorted(plugs, key=lambda plug: plug[2].number is None):  # the rest take what is left
                before = wire.transport
                dev.in_loop(lambda wire=wire, port=port: _change(wire, port))
                if dev in keep:
                    undo.callback(_take_out, dev, wire, before)
            if self._expose and not self.network:
                raise TransportError(
                    "--expose: without a CAN bus the view has the machine's network, with all its ports"
                )
            for port in self._expose:
                self._exposed.append(Exposed(self._keeper.ask, port))
                undo.callback(self._exposed[-1].close)
            self._undo = undo.pop_all()
        return self

    def stop(self) -> None:
        """Unplug everything; what still runs in the view finds its ports gone. Safe to call twice."""
        self._undo.close()

    def __enter__(self) -> ExecEnvironment:
        return self.start()

    def __exit__(self, *_) -> None:
        self.stop()

    # -- what runs in it -----------------------------------------------------------------------------------------------

    @property
    def nodes(self) -> dict[str, str]:
        """Path of each port in the view, interface of each bus, and address of what is on the network; by skin, or by
        ``SKIN/CONNECTOR``."""
        ports = {**self._ports, **self._on_network}
        return {title: port.channel if isinstance(port, BusPort) else port.address for title, port in ports.items()}

    @property
    def keeper(self) -> int:
        """Process id of the view's keeper; its namespaces are the view."""
        assert self._keeper is not None, "use it in a with statement"
        return self._keeper.pid

    def command(self, command: Sequence[str | os.PathLike[str]]) -> list[str]:
        """Return a command line that runs ``command`` in the view, whoever starts it: ``subprocess``, a shell, a
        launcher.

        What it starts in turn is in the view too. Its exit status is that of ``command``; 125: the view has gone, 126:
        not executable, 127: not found.
        """
        assert self._keeper is not None, "use it in a with statement"
        return self._keeper.enter([os.fspath(word) for word in command])

    def popen(self, command: Sequence[str | os.PathLike[str]], **options: Any) -> subprocess.Popen[Any]:
        """Start ``command`` in the view; ``options`` are those of :class:`subprocess.Popen`."""
        return subprocess.Popen(self.command(command), **options)

    def run(self, command: Sequence[str | os.PathLike[str]], **options: Any) -> subprocess.CompletedProcess[Any]:
        """Run ``command`` in the view; ``options`` are those of :func:`subprocess.run`."""
        return subprocess.run(self.command(command), check=options.pop("check", False), **options)

    # -- what is plugged in --------------------------------------------------------------------------------------------

    def _plugs_of(self, dev: Served) -> Iterator[tuple[Served, Wire, UsbPort | BusPort]]:
        """Every serial port and CAN bus of a device, and what is to be at the end of its wire."""
        wires = set()
        for channel in dev.emulator.channels:
            for name, wire in channel.wires.items():
                connector = channel.device.connector(name)
                title = f"{channel.name}/{name}" if len(channel.wires) > 1 else channel.name
                if isinstance(connector, Can) and isinstance(wire.transport, BusPort):  # it has been put there already
                    self._ports[title] = wire.transport
                elif isinstance(connector, Can | Serial) and wire not in wires:
                    wires.add(wire)
                    serial = isinstance(connector, Serial)
                    port = self._port(title, channel.device, connector) if serial else self._bus(title, wire)
                    self._ports[title] = port
                    yield dev, wire, port
                elif wire.line_model.is_network:
                    self._on_network[title] = wire.transport

    def _check_network(self) -> None:
        """Refuse what would be on a network that the driver does not see.

        Raises:
            TransportError: there is a CAN bus too, and no way to the port.
        """
        for title, port in self._on_network.items() if self._buses else ():
            number = urlsplit(port.address).port if port.scheme in ("tcp", "ws") else None
            if number is None or number not in self._expose:
                fix = f"; --expose tcp:{number} leads to it" if number else "; use `tactemu run` for it"
                raise TransportError(
                    f"{title} is at {port.address} of this machine, and with the bus {min(self._buses)} the driver has "
                    f"a network of its own{fix}"
                )

    def _put_on_buses(self, emulator: Any) -> None:
        """The CAN buses of an emulator that is about to start: what they are called here, they are in the view."""
        for channel in emulator.channels:
            for name, wire in channel.wires.items():
                if isinstance(channel.device.connector(name), Can) and not isinstance(wire.transport, BusPort):
                    title = f"{channel.name}/{name}" if len(channel.wires) > 1 else channel.name
                    wire.transport = self._bus(title, wire)

    def _bus(self, title: str, wire: Wire) -> BusPort:
        """Return the interface asked for, else of the name that the scene has for it, else the lowest that is free."""
        assert self._keeper is not None
        taken = {port.channel for port in self._ports.values() if isinstance(port, BusPort)} | self._buses
        number = next(number for number in range(len(taken) + 1) if f"can{number}" not in taken)
        name = f"can{number}"
        if isinstance(wire.transport, SocketCanTransport):
            name = wire.transport.channel
        for owner in ("", title, title.partition("/")[0]):
            if owner in self._wishes and self._wishes[owner][0] == "can":
                name = f"can{self._wishes.pop(owner)[1]}"
                break
        self._buses.add(name)
        return BusPort(self._keeper.ask, name, self._way)

    @property
    def network(self) -> str:
        """How the view's CAN buses are made, and what else is in its network; empty where it is the machine's."""
        ways = {port.channel: port.way for port in self._ports.values() if isinstance(port, BusPort)}
        if not ways:
            return ""
        made = WAYS[next(iter(ways.values()))].format(names=", ".join(ways))
        through = "".join(f"; {each}" for each in self._exposed) or ", no port of the machine"
        return f"{made}. The view has a network of its own: loopback and these buses{through}"

    def _port(self, title: str, device: Device, connector: Serial) -> UsbPort:
        assert self._keeper is not None
        usb, number = _declared(connector, device, title), None
        for owner in ("", title, title.partition("/")[0]):
            if owner in self._wishes:
                usb["node"], number = self._wishes.pop(owner)
                break
        board = (id(device), usb["vid"], usb["pid"], usb["serial"])
        socket = self._sockets.setdefault(board, len(self._sockets) + 1)
        return UsbPort(Node(self._keeper.ask, usb, number=number, plug=socket))


def _change(wire: Wire, port: Transport) -> None:
    """Another port at the end of a wire; if it cannot be opened, the former one."""
    before = wire.transport
    before.close()
    port.set_connector(wire.line_model.connector)
    try:
        port.open()
    except BaseException:
        before.open()
        raise
    wire.transport = port


def _take_out(dev: Served, wire: Wire, before: Transport) -> None:
    if dev.running:
        dev.in_loop(lambda: _change(wire, before))


def _declared(connector: Serial, device: Device, title: str) -> dict[str, Any]:
    """What the USB device says of itself. One that declares no serial number has the same at each run."""
    usb = connector.usb
    if usb is True:
        usb = replace(_BOARD, product=device.title)
    elif usb is False:
        usb = _ADAPTER
    told = asdict(usb)
    told["serial"] = told["serial"] or hashlib.sha256(title.encode()).hexdigest()[:8].upper()
    return told


def _nodes_in(nodes: Mapping[str, str]) -> dict[str, tuple[str, int]]:
    """``ttyUSB0`` as kind and number.

    Raises:
        TransportError: it is no name of a serial port or a CAN interface.
    """
    found = {}
    for owner, node in nodes.items():
        match = _NODE.fullmatch(node)
        if not match:
            raise TransportError(
                f"node {node!r}: expected ttyUSB0, ttyACM0, can0, or a UART: {', '.join(CHIPS)} and a number"
            )
        found[owner] = (match[1], int(match[2]))
    return found
