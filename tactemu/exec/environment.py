"""Views of the machine with emulated devices, and commands that run in them.

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
from tactemu.transports.tcp import TcpTransport
from tactemu.wire.wire import Wire

_NODE = re.compile(rf"(?:/dev/)?(ttyUSB|ttyACM|can|{'|'.join(CHIPS)})(\d{{1,3}})")
_ADAPTER = USB(0x0403, 0x6001, manufacturer="FTDI", product="FT232R USB UART", node="ttyUSB")
"""The USB adapter of a board with a plain UART."""
_BOARD = USB(0x1209, 0x0001, manufacturer="tactemu", node="ttyACM")
"""A board with USB whose ids are not declared, with pid.codes' number for tests."""


def exec_environment(
    *devices: Served, nodes: str | Mapping[str, str] = "", way: str = "", expose: Sequence[str] = ()
) -> ExecEnvironment:
    """Return a view of this machine in which the ports of ``devices`` are serial ports and CAN interfaces.

    Devices that are not running are started, and stopped at the end; running ones get their former ports back.

    Args:
        devices: results of :func:`tactemu.serve`.
        nodes: ``ttyUSB0`` for the only port, or nodes by skin or ``SKIN/CONNECTOR``; default: as the kernel would name
            them, from ``ttyACM0``, ``ttyUSB0`` or ``can0`` upwards. ``ttyS0``, ``ttyAMA0``, ``ttyTHS1`` and so on are
            UARTs of the board itself.
        expose: ``tcp:PORT``, ports to forward between the machine's network and that of a view with CAN buses.
        way: how CAN buses are made, ``native`` (vcan) or ``preload``; default: native if this kernel can, else preload.

    Raises:
        TactemuError: this machine allows no such view (the message names reason and remedy), or a skin or node does not
            exist.
    """
    return ExecEnvironment(devices, nodes, way, expose)


class ExecEnvironment:
    """A view of the machine with devices plugged in; :func:`exec_environment` returns it."""

    def __init__(
        self,
        devices: Sequence[Served],
        nodes: str | Mapping[str, str] = "",
        way: str = "",
        expose: Sequence[str] = (),
    ):
        self.devices = tuple(devices)
        """The plugged-in devices, which a test can press and disturb."""
        self._requested_nodes = _nodes_in({"": nodes} if isinstance(nodes, str) and nodes else dict(nodes or {}))
        self._keeper: Keeper | None = None
        self._undo = ExitStack()
        self._hub_ports: dict[tuple[Any, ...], int] = {}
        """The number of the hub's port of each USB device."""
        self._ports: dict[str, UsbPort | BusPort] = {}
        self._on_network: dict[str, Transport] = {}
        """The ports that a program reaches by an address, by title."""
        self._buses: set[str] = set()
        """The names of the CAN interfaces."""
        if way not in ("", *WAYS):
            raise TransportError(f"way {way!r}: expected {' or '.join(WAYS)}")
        self._way = way
        self._expose = [parsed(text) for text in expose]
        self._exposed: list[Exposed] = []
        self.missing = ""
        """The reason why there is no preload library; empty if there is one."""

    # -- life ----------------------------------------------------------------------------------------------------------

    def start(self) -> ExecEnvironment:
        """Make the view and plug everything in.

        Raises:
            TactemuError: the view cannot be made; nothing is left behind.
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
                    dev._session.before_opening = self._put_on_buses
                    undo.enter_context(dev)
            self._keeper.wait()
            connections = [each for dev in self.devices for each in self._connections_of(dev)]
            if self._requested_nodes:
                known = ", ".join(self._ports) or "none"
                known += "".join(f"; {title} is at {port.address}" for title, port in self._on_network.items())
                raise TransportError(f"no such port: {', '.join(self._requested_nodes)} (available: {known})")
            self._check_network()
            for dev, wire, port in sorted(connections, key=lambda each: each[2].number is None):  # fixed numbers first
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
        """Unplug everything; programs that still run in the view find their ports gone. Safe to call twice."""
        self._undo.close()

    def __enter__(self) -> ExecEnvironment:
        return self.start()

    def __exit__(self, *_) -> None:
        self.stop()

    # -- what runs in it -----------------------------------------------------------------------------------------------

    @property
    def nodes(self) -> dict[str, str]:
        """The path of each port in the view, the interface of each bus, and the address of each network port; by skin
        or ``SKIN/CONNECTOR``."""
        ports = {**self._ports, **self._on_network}
        return {title: port.channel if isinstance(port, BusPort) else port.address for title, port in ports.items()}

    @property
    def keeper(self) -> int:
        """The process id of the view's keeper, whose namespaces are the view."""
        assert self._keeper is not None, "use it in a with statement"
        return self._keeper.pid

    def command(self, command: Sequence[str | os.PathLike[str]]) -> list[str]:
        """Return a command line that runs ``command`` in the view, for ``subprocess``, a shell or a launcher.

        Its children are in the view, too. Its exit status is that of ``command``; 125: the view has ended, 126: not
        executable, 127: not found.
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

    def _connections_of(self, dev: Served) -> Iterator[tuple[Served, Wire, UsbPort | BusPort]]:
        """Yield every serial port and CAN bus of a device, with the new transport of its wire."""
        wires = set()
        for channel in dev.emulator.channels:
            for name, wire in channel.wires.items():
                connector = channel.device.connector(name)
                title = f"{channel.name}/{name}" if len(channel.wires) > 1 else channel.name
                if isinstance(connector, Can) and isinstance(
                    wire.transport, BusPort
                ):  # _put_on_buses has made it already
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
        """Check that the driver can reach all devices on the network.

        Raises:
            TransportError: with a CAN bus the view has its own network, and the port is not forwarded.
        """
        for title, port in self._on_network.items() if self._buses else ():
            number = urlsplit(port.address).port if isinstance(port, TcpTransport) else None
            if number is None or number not in self._expose:
                fix = f"; forward it with --expose tcp:{number}" if number else "; use `tactemu run` for it"
                raise TransportError(
                    f"{title} is at {port.address} of this machine, and with the bus {min(self._buses)} the driver has "
                    f"a network of its own{fix}"
                )

    def _put_on_buses(self, emulator: Any) -> None:
        """Put the CAN buses of a starting emulator into the view under their names."""
        for channel in emulator.channels:
            for name, wire in channel.wires.items():
                if isinstance(channel.device.connector(name), Can) and not isinstance(wire.transport, BusPort):
                    title = f"{channel.name}/{name}" if len(channel.wires) > 1 else channel.name
                    wire.transport = self._bus(title, wire)

    def _bus(self, title: str, wire: Wire) -> BusPort:
        """Return the requested interface, else that named by the scene, else the lowest free one."""
        assert self._keeper is not None
        taken = {port.channel for port in self._ports.values() if isinstance(port, BusPort)} | self._buses
        number = next(number for number in range(len(taken) + 1) if f"can{number}" not in taken)
        name = f"can{number}"
        if isinstance(wire.transport, SocketCanTransport):
            name = wire.transport.channel
        for owner in ("", title, title.partition("/")[0]):
            if owner in self._requested_nodes and self._requested_nodes[owner][0] == "can":
                name = f"can{self._requested_nodes.pop(owner)[1]}"
                break
        self._buses.add(name)
        return BusPort(self._keeper.ask, name, self._way)

    @property
    def network(self) -> str:
        """The description of the view's own network; empty if it has that of the machine."""
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
            if owner in self._requested_nodes:
                usb["node"], number = self._requested_nodes.pop(owner)
                break
        board = (id(device), usb["vid"], usb["pid"], usb["serial"])
        hub_port = self._hub_ports.setdefault(board, len(self._hub_ports) + 1)
        return UsbPort(Node(self._keeper.ask, usb, number=number, hub_port=hub_port))


def _change(wire: Wire, port: Transport) -> None:
    """Exchange the transport of a wire; if the new one cannot be opened, restore the former one."""
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
    """Return the description of the USB device; without a declared serial number it has the same one in each run."""
    usb = connector.usb
    if usb is True:
        usb = replace(_BOARD, product=device.title)
    elif usb is False:
        usb = _ADAPTER
    described = asdict(usb)
    described["serial"] = described["serial"] or hashlib.sha256(title.encode()).hexdigest()[:8].upper()
    return described


def _nodes_in(nodes: Mapping[str, str]) -> dict[str, tuple[str, int]]:
    """Return ``ttyUSB0`` as prefix and number, for each owner.

    Raises:
        TransportError: a name is not that of a serial port or a CAN interface.
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
