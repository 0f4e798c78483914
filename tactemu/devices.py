"""The face for devices of your own: the public names that such a file imports, all of :mod:`firmware_protocols`.

>>> from tactemu.devices import Device, create
>>> isinstance(create("anyskin"), Device)
True

A device needs nothing of the simulation: a file that imports the same names from :mod:`firmware_protocols` works with
that package alone, as the two of ``docs/adding-a-device.md`` do. Import from a face, never from the modules below it,
which may change in every version (``docs/versions.md``). The names that run a device (``serve``) are in :mod:`tactemu`.
"""

from firmware_protocols import (
    DEVICES,
    MORE,
    NO_PACKET,
    SOUND,
    USB,
    Answer,
    Axis,
    Broken,
    Can,
    CanFrame,
    CanFrames,
    Cobs,
    Column,
    Command,
    Connector,
    Convert,
    Counts,
    Dds,
    Device,
    Fact,
    Frame,
    Identifier,
    Layout,
    LinearMagnet,
    Lines,
    LowPass,
    Memory,
    Motors,
    Option,
    Packets,
    Patch,
    Ppp,
    Quantity,
    Reading,
    Refused,
    RegisterMap,
    Registers,
    Restart,
    Rollover,
    Rs485,
    Sense,
    Sent,
    Serial,
    Setpoints,
    Stream,
    TableError,
    Tcp,
    Topic,
    Transmissions,
    Udp,
    WebSocket,
    WireFrame,
    assumed,
    cobs,
    create,
    device_class,
    dynamixel,
    eb90,
    fact_table,
    feetech,
    filled,
    grid_layout,
    http,
    idl,
    int16,
    measured,
    modbus,
    names,
    pack_12_bits,
    place,
    points,
    ppp,
    quantize,
    stack,
    stated,
    sums,
    with_payload,
)

__all__ = [  # noqa: RUF022  (in groups)
    # the contract of a device: readings and the driver's bytes go in, frames come out
    "Axis", "CanFrame", "CanFrames", "Convert", "Counts", "Device", "Option", "Quantity", "Reading", "Restart",
    "Sent", "Transmissions", "WireFrame", "with_payload",
    # its datasheet: connectors, senses and streams, commands, the meaning of counts, the basis of each fact
    "Can", "Column", "Command", "Connector", "Dds", "Fact", "Rollover", "Rs485", "Sense", "Serial", "Stream", "Tcp",
    "Topic", "USB", "Udp", "WebSocket", "assumed", "fact_table", "measured", "stated",
    # layouts of taxels
    "Layout", "Patch", "filled", "grid_layout", "place", "points", "stack",
    # frame tables, packets in a stream of bytes, checksums, types of DDS
    "Broken", "Cobs", "Frame", "Identifier", "Lines", "MORE", "NO_PACKET", "Packets", "Ppp", "SOUND", "TableError",
    "cobs", "idl", "ppp", "sums",
    # registers, and the protocols that read and write them
    "Answer", "Memory", "Refused", "RegisterMap", "Registers", "dynamixel", "eb90", "feetech", "http", "modbus",
    # converters, magnets and motors
    "LinearMagnet", "LowPass", "Motors", "Setpoints", "int16", "pack_12_bits", "quantize",
    # the registry
    "DEVICES", "create", "device_class", "names",
]  # fmt: skip
