"""Modbus of BrainCo's hands in CAN-FD frames.

The datasheets are :mod:`firmware_protocols.devices.brainco_revo2` and :mod:`firmware_protocols.devices.brainco_revo3`.
"""

from typing import Any

from firmware_protocols import Can, CanFrame, CanRequests, Identifier
from firmware_protocols.protocols.modbus import Banks, answer, rtu
from firmware_protocols.sums import crc16_modbus

FUNCTIONS = (3, 4, 6, 16)
MAX_CAN_DATA_BYTES = 64
"""The bytes of a CAN-FD frame; a longer answer becomes exception 3."""


def plug(hand: Any) -> None:
    """Put a hand on CAN-FD: its extended id is unit << 16 | host << 8 | bytes of the Modbus frame."""
    ident = Identifier(f"{hand.unit:013b}hhhhhhhhssssssss", {"host": "h", "size": "s"})
    hand.packets = CanRequests(ident, by="", is_fd=True)
    hand.ports = (Can(data_bitrate=5_000_000, filters=(ident.filter(),)),)


def answers(hand: Any, data: CanFrame, t_ns: int) -> list[CanFrame]:
    """Return the answer of a hand, whose registers it reads and writes, to the request in one frame."""
    asked = hand.packets.fields(data)
    if asked is None:
        hand.counters["ignored"] += 1
        return []
    adu = data.data[: asked["size"]]
    if len(adu) < 4 or len(adu) != asked["size"] or adu[0] != hand.unit or crc16_modbus(adu):
        hand.counters["bad_checksum"] += 1
        return []
    hand.counters["requests"] += 1
    reply = answer(adu[1:-2], Banks(holding=hand, inputs=hand, functions=FUNCTIONS), t_ns)
    if len(reply) + 3 > MAX_CAN_DATA_BYTES:
        reply = bytes([adu[1] | 0x80, 3])
    frame = rtu(hand.unit, reply)
    return [hand.packets.frame(asked["id"] & ~0xFF | len(frame), frame)]
