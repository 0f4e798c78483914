"""The assignment of devices' connectors to ports: by the user, else by the scene, else the usual ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from firmware_protocols import Connector, Device
from tactemu import transports
from tactemu.base.errors import DeviceError, SceneError, TransportError, no_such
from tactemu.scene.schema import SkinTable
from tactemu.wire.line_models import line_model_for


@dataclass(frozen=True)
class PortAssignment:
    """One connector of one device in one port."""

    skin: str
    connector: Connector
    address: str
    """The port, as for ``--port``: ``scheme:address``."""


def assign_ports(
    skins: Sequence[SkinTable],
    devices: Mapping[str, Device],
    requested: str | Mapping[str, str] | None,
    *,
    fresh: bool = False,
    usual_network: bool = False,
) -> list[PortAssignment]:
    """Return the port of every connector that is in use.

    Args:
        skins: the skins of the scene.
        devices: the devices, by the skin's name.
        requested: one port for the first connector that fits it, or ports by ``SKIN``, ``PORT`` or ``SKIN/PORT``.
        fresh: take an unused port instead of the usual one, where neither user nor scene names one.
        usual_network: keep the usual port on the network, also with ``fresh``.

    Raises:
        DeviceError: a device has no connector that fits the port, or none of that name.
        SceneError: two devices would share a port that cannot be shared.
        TransportError: an address is not valid, or two devices on one bus have different speeds.
    """
    fresh_kinds = (fresh and not usual_network, fresh)
    wanted = {} if requested is None or isinstance(requested, str) else dict(requested)
    assignments = []
    for skin in skins:
        device = devices[skin.title]
        single, named = skin.port, dict(skin.ports)
        if isinstance(requested, str):
            single = requested
        single = wanted.pop(skin.title, single)
        for connector in device.ports:
            for key in (f"{skin.title}/{connector.name}", connector.name):
                if key in wanted:
                    named[connector.name] = wanted.pop(key)
        assignments += _assign_ports_of(skin.title, device, single, named, fresh_kinds)
    if wanted:
        known = [skin.title for skin in skins] + [f"{s.title}/{c.name}" for s in skins for c in devices[s.title].ports]
        raise DeviceError(no_such("port", next(iter(wanted)), known))
    return _shared([_own_memory(assignment, assignments) for assignment in assignments])


def _assign_ports_of(
    skin: str, device: Device, single: str | None, named: dict[str, str], fresh: tuple[bool, bool]
) -> list[PortAssignment]:
    """Return the ports of one device's connectors; ``fresh``: use unused ports on the network, and elsewhere."""
    connectors = {connector.name: connector for connector in device.ports}
    for name in named:
        if name not in connectors:
            raise DeviceError(f"{device.name} has {no_such('port', name, connectors)}")
    first = device.ports[0]
    used = {each.name for each in device.ports if each is first or each.is_plugged or each.name in named}
    if single is not None:
        chosen = _fitting(device, single)
        named = {chosen.name: single} | named
        if not chosen.is_plugged:
            used.discard(first.name)
        used.add(chosen.name)
    return [
        PortAssignment(skin, each, named.get(each.name) or _default_port(skin, device, each, fresh))
        for each in device.ports
        if each.name in used
    ]


def _default_port(skin: str, device: Device, connector: Connector, fresh: tuple[bool, bool]) -> str:
    name = skin if len(device.ports) == 1 or not connector.name else f"{skin}-{connector.name}"
    name = skin if connector is device.ports[0] and not any(each.is_plugged for each in device.ports[1:]) else name
    line_model = line_model_for(connector)
    return line_model.fresh_port(name) if fresh[not line_model.is_network] else line_model.usual_port(name)


def _fitting(device: Device, address: str) -> Connector:
    """Return the connector that fits a port best."""
    transports.create(address)  # raises its own error for an address that is not valid
    scheme = address.partition(":")[0]
    if scheme == "memory":
        return device.ports[0]
    fits = [(line_model_for(each).schemes, each) for each in device.ports]
    fits = [(schemes.index(scheme), each) for schemes, each in fits if scheme in schemes]
    if not fits:
        has = " or ".join(dict.fromkeys(line_model_for(each).kind for each in device.ports))
        schemes = dict.fromkeys(name for each in device.ports for name in line_model_for(each).schemes)
        possible = ", ".join(f"{name}:" for name in (*schemes, "memory"))
        usual = line_model_for(device.ports[0]).usual_port(device.name)
        raise DeviceError(
            f"{device.name} has a {has} connector and cannot be plugged into {scheme}:; ports that fit: {possible} "
            f"(without one: {usual})"
        )
    return min(fits, key=lambda entry: entry[0])[1]


def _own_memory(assignment: PortAssignment, assignments: Sequence[PortAssignment]) -> PortAssignment:
    """Return the assignment with a port of its own, where several connectors have the address ``memory:``."""
    if assignment.address == "memory:" and sum(other.address == "memory:" for other in assignments) > 1:
        name = f"{assignment.skin}/{assignment.connector.name}" if assignment.connector.name else assignment.skin
        return PortAssignment(assignment.skin, assignment.connector, f"memory:{name}")
    return assignment


def _shared(assignments: list[PortAssignment]) -> list[PortAssignment]:
    holders: dict[str, PortAssignment] = {}
    for each in assignments:
        first = holders.setdefault(each.address, each)
        if first is each:
            continue
        line_model = line_model_for(first.connector)
        if not line_model.is_shared:
            raise SceneError(
                f"skins {each.skin!r} and {first.skin!r} cannot share {each.address}; {line_model.describe()} has "
                "one device. Give each skin a `port` of its own in the scene file"
            )
        if not line_model.agrees(each.connector):
            raise TransportError(
                f"{each.address}: {first.skin!r} needs {line_model.describe()} and {each.skin!r} "
                f"{line_model_for(each.connector).describe()}; put them on two buses"
            )
    return assignments
