"""``dds:DOMAIN``: a participant of a DDS domain, by Cyclone DDS.

It writes the topic of the device's connector and reads another; ``dds:DOMAIN/TOPIC`` renames the written topic. It is
on loopback only; name an interface (``dds:eth0:0``) to be reached from other machines. There is no connection: the port
counts as opened while the topic has a reader, and nothing waits for one.

Cyclone's own threads receive; received samples wait in a bounded queue for the next poll. A forked child keeps
Cyclone's sockets until it ends, but neither uses nor removes what its parent made.
"""

from __future__ import annotations

import ctypes
import dataclasses
import os
import types as python_types
from typing import Any
from weakref import WeakValueDictionary

import cyclonedds.idl.types as t
from cyclonedds.core import DDSException, Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct, annotations
from cyclonedds.pub import DataWriter, Publisher
from cyclonedds.sub import DataReader, Subscriber
from cyclonedds.topic import Topic

from firmware_protocols import Connector, Dds, WireFrame, idl
from firmware_protocols.cdr import HEADER
from tactemu.base.errors import TransportError
from tactemu.transports import inet
from tactemu.transports.forks import close_in_children
from tactemu.transports.transport import DROPPED, RAISED, Closed, Event, Opened, Received, Transport

LOOPBACK = "lo"
_MAX_QUEUED_SAMPLES = 32
"""Maximum number of samples that wait, and that one poll takes."""
_CONFIG = (
    "<CycloneDDS><Domain Id='any'><General><Interfaces><NetworkInterface name='{}'/></Interfaces></General>"
    "</Domain></CycloneDDS>"
)
_QOS = Qos(
    Policy.Reliability.Reliable(0),  # never wait for a slow reader
    Policy.History.KeepLast(1),
    Policy.DataRepresentation(use_cdrv0_representation=True),
)
_READING = Qos(Policy.History.KeepLast(_MAX_QUEUED_SAMPLES))
_NUMBERS = {
    "float": t.float32, "int8": t.int8, "uint8": t.uint8, "int16": t.int16, "uint16": t.uint16, "int32": t.int32,
    "uint32": t.uint32,
}  # fmt: skip


class _Joined(Domain):
    """A domain on one interface. Cyclone has one per domain and process, until the last reference to it is gone."""

    def __init__(self, number: int, interface: str):
        super().__init__(number, _CONFIG.format(interface))
        self.interface = interface


_JOINED: WeakValueDictionary[int, _Joined] = WeakValueDictionary()


class DdsTransport(Transport):
    """A DDS writer, and a reader where the device has one."""

    scheme = "dds"

    def __init__(self, location: str):
        where, _, self._topic = location.partition("/")
        interface, _, domain = where.rpartition(":")
        if not domain.isdecimal() or int(domain) > 232:
            raise TransportError(
                f"port 'dds:{location}': expected dds:DOMAIN, dds:INTERFACE:DOMAIN or dds:DOMAIN/TOPIC, DOMAIN 0 to 232"
            )
        self.interface, self.domain = interface or LOOPBACK, int(domain)
        self.address = f"dds:{location}"
        self._connector: Dds | None = None
        self._writer: DataWriter | None = None
        self._reader: DataReader | None = None
        self._kept: list[Any] = []
        """Topics, participant and domain, in the order in which they must be freed."""
        self._maker = 0
        """The id of the process that opened the port."""
        self._has_driver = False

    def set_connector(self, connector: Connector) -> None:
        """Take over topics and types from the connector."""
        assert isinstance(connector, Dds)
        self._connector = connector

    def open(self) -> None:
        """Join the domain, without waiting for a reader.

        Raises:
            TransportError: the interface cannot be had, or the domain is already on another one in this process.
        """
        if self._writer is not None:
            return
        if self._connector is None:
            raise TransportError(f"port {self.address!r}: its topics are unknown; call set_connector() before open()")
        domain = self._join()
        written, read = self._connector.writes, self._connector.reads
        known = types_of(self._connector.idl)
        participant = DomainParticipant(self.domain)
        topic = Topic(participant, self._topic or written.name, known[written.type])
        self._writer = DataWriter(Publisher(participant), topic, _QOS)
        self._kept = [topic, participant, domain]
        if read is not None:
            read_topic = Topic(participant, read.name, known[read.type])
            self._reader = DataReader(Subscriber(participant), read_topic, _READING)
            self._kept.insert(0, read_topic)
        self._maker = os.getpid()
        close_in_children(self)
        if self.interface != LOOPBACK:
            inet.warn_if_reachable(self.address, "0.0.0.0")

    def _join(self) -> _Joined:
        joined = _JOINED.get(self.domain)
        if joined is None:
            try:
                joined = _JOINED[self.domain] = _Joined(self.domain, self.interface)
            except DDSException as error:
                raise TransportError(f"{self.address}: cannot join on {self.interface!r}: {error.msg}") from None
        if joined.interface != self.interface:
            raise TransportError(f"{self.address}: this process has this domain on {joined.interface!r}; take another")
        return joined

    def close(self) -> None:
        """Leave: readers learn that the writer has gone."""
        if self._maker and self._maker != os.getpid():
            for each in (self._writer, self._reader, *self._kept):  # they are the parent's and must not be freed here
                ctypes.pythonapi.Py_IncRef(ctypes.py_object(each))
        self._writer = self._reader = None
        while self._kept:
            del self._kept[0]
        self._has_driver = False

    def filenos(self, reading: bool = True) -> list[int]:
        """Return no file descriptors: the port is polled."""
        return []

    def poll(self, reading: bool = True) -> list[Event]:
        """Return openings, closings, and samples of the topic that is read."""
        events: list[Event] = []
        if self._writer is None:
            return events
        has_reader = bool(self._writer.get_matched_subscriptions())
        if has_reader != self._has_driver:
            self._has_driver = has_reader
            events += [Opened(), RAISED] if has_reader else [Closed(), DROPPED]
        if self._reader is not None and reading:
            for sample in self._reader.take(_MAX_QUEUED_SAMPLES):
                if (data := getattr(sample, "data", b"")).startswith(HEADER):
                    events.append(Received(data[len(HEADER) :]))
        return events

    def write(self, frame: WireFrame) -> bool:
        """Write one sample; ``False`` when the topic has no reader, or the bytes are no sample of its type."""
        if not isinstance(frame, bytes):
            raise TransportError(f"DDS cannot carry the CAN frame {frame}")
        if self._writer is None or not self._has_driver:
            return False
        try:
            self._writer.write(self._writer.data_type.deserialize(HEADER + frame))
        except DDSException:
            return False
        return True

    @property
    def has_reader(self) -> bool:
        """True while the topic has a reader."""
        return self._has_driver


def types_of(text: str) -> dict[str, type[IdlStruct]]:
    """Return the types that an IDL declares, by name. Their samples keep their bytes unchanged."""
    known: dict[str, Any] = dict(_NUMBERS)
    for name, members in idl.structs(text).items():
        kinds = {}
        for each in members:
            kind = known[each.type]
            kinds[each.name] = t.sequence[kind] if each.sequence else t.array[kind, each.count] if each.count else kind
        known[name] = _struct(name, kinds)
    return known


def _struct(name: str, members: dict[str, Any]) -> type[IdlStruct]:
    def body(namespace: dict[str, Any]) -> None:
        namespace["__annotations__"] = members

    plain = python_types.new_class(name.rpartition(":")[2], (IdlStruct,), {"typename": name.replace("::", ".")}, body)
    found: Any = annotations.autoid("sequential")(annotations.final(dataclasses.dataclass(plain)))

    def deserialize(cls: Any, data: bytes, **_: Any) -> Any:
        sample = object.__new__(cls)
        sample.data = bytes(data)
        return sample

    found.deserialize = classmethod(deserialize)
    found.serialize = lambda sample, **_: sample.data
    return found
