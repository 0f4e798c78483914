r"""PaXini PX-6AX behind the GEN3 serial converter board.

Wire: 921600 8N1. One request, one reply; the board never speaks unasked.

    action       function  address  count        data in the reply
    resultant    FB        0x3F0    3            Fx int8, Fy int8, Fz uint8, 0.1 N each
    taxels       FB        0x40E    3 n          the same per taxel
    both         FB        0x3F0    30 + 3 n     taxels start at +30
    version      FB        6100     100          ASCII, padded with 00; holds the module's part code
    zero         79        3        1            none; 01: what is felt now is zero, 00: accepted, changes nothing

Real boards answer reads with status 01 although the data are good, and writes with 00; other codes as the GEN2 box.
The requests of version, resultant and zero and their replies are captured frames. One note in fengjh97/paxini says that
an official example takes data from offset 13; the vendor's viewer takes 14.

Try it: ``tactemu run paxini_px6ax``, then any driver of the board at 921600.
"""

from __future__ import annotations

from typing import Annotated, Any

from firmware_protocols import Command, Option, Outs, Serial
from firmware_protocols.devices.paxini_modules import GAP_NS, Model, Px6axDevice
from firmware_protocols.framing import MORE, SOUND, Broken, Packets
from firmware_protocols.sums import lrc8
from firmware_protocols.tables import Frame

REQUEST = Frame("""
    request
    0     55 AA       head
    2     <u2         length = total - 5
    4     u1          device                its number
    5     u1          reserved              00; not looked at
    6     u1          function              FB read, 79 write
    7     <u4         address
    11    <u2         count
    13    bytes       data                  writes
    last  lrc8        check
""")
REPLY = Frame("""
    reply, the request's fields repeated
    0     AA 55       head
    2     <u2         length = total - 5
    4     u1          device
    5     00          reserved
    6     u1          function
    7     <u4         address
    11    <u2         count
    13    u1          status
    14    bytes       data                  reads
    last  lrc8        check
""")
SHORTEST, LONGEST_DATA = 14, 64
READ, WRITE = 0xFB, 0x79
VERSION, VERSION_BYTES = 6100, 100
ZERO = 3

WRITTEN, READ_DONE, BAD_LENGTH, BAD_LRC, BAD_FUNCTION, BAD_ADDRESS = 0, 1, 1, 2, 3, 6
PART_CODES = {
    "L3530": "DP03A", "M2826": "DP03B", "S2716": "DP03C", "S1813C": "DP03D", "S3013": "DP03E", "S1813E": "DP03F",
    "S2015": "DP03G", "M2324": "IP03A", "S1610": "IP03B", "L5325": "CP03A", "M3025": "CP03B", "M2020": "MC03A",
}  # fmt: skip
"""The part code is PXSR-STD and this; hosts pick the model by looking for it in the version text."""


class PaxiniPx6ax(Px6axDevice):
    """Modules behind a GEN3 converter board, which answers requests."""

    name = "paxini_px6ax"
    title = "PaXini PX-6AX, GEN3 serial converter board"
    kind = "fingertip"
    ports = (Serial(baud=921600),)
    rate_hz = 1000 / 12
    evidence = ("captured", "driver")
    sources = (
        "yknxh/paxini-toolkit@1596843 tests/test_codec.py (captured frames), codec.py SENSOR_TYPES, sim.py (status 01)",
        "paxini-sdk 0.1.0 boards/serial_converter.py, data/registry.json (part codes)",
        "fengjh97/paxini@e8e6bcc paxini_sensor.py l.16-29",
        "adnan-saood/paxini_ros2@25009ba",
    )
    judge = "paxini-sdk 0.1.0"
    assumed = (
        "places of the taxels: even rows on a flat pad of the size in the model's name",
        "Fx, Fy along the pad's x, y; the resultant is the sum over the pad",
        "status codes as the GEN2 box: 1 length, 2 LRC, 3 function, 6 address; a module that is not there is silent",
        "it converts every 12 ms, as its host polls; a half request is forgotten after 50 ms",
        "taxels in rows as they lie on the pad",
    )

    def __init__(
        self,
        *,
        models: Annotated[Model | tuple[Model, ...], Option("one model name, or several")] = "S1813E",
        places: Annotated[
            tuple[int, ...] | None,
            Option("device id of each module; by default one answers to all, several to 0, 1 ..."),
        ] = None,
        version: Annotated[str | None, Option("text at address 6100; default: the first model's part code")] = None,
    ):
        self._power_up(models, places)
        text = version or f"PAXINI PXSR-STD{PART_CODES[self.models[0]]}-v1.0.5"
        self.version = text.encode("ascii")[:VERSION_BYTES].ljust(VERSION_BYTES, b"\0")
        self.packets = Packets(REQUEST.head, _size, _check, counters=self.counters, gap_ns=GAP_NS, broken=True)

    @property
    def commands(self) -> tuple[Command, ...]:
        """The actions on a single module of the usual kind, which answers to every id."""
        if self.places is not None or self.models != ("S1813E",):
            return ()
        captured, tables = "yknxh/paxini-toolkit@1596843 tests/test_codec.py", "paxini-sdk 0.1.0 serial_converter.py"
        return (
            Command(
                name="version",
                request="55 AA 09 00 03 00 FB D4 17 00 00 64 00 AB",
                reply="AA 55 6E 00 03 00 FB D4 17 00 00 64 00 01 50 41 58 49 4E 49 20 ..{93} ..",
                origin=captured,
            ),
            Command(
                name="resultant",
                request="55 AA 09 00 03 00 FB F0 03 00 00 03 00 04",
                reply="AA 55 0D 00 03 00 FB F0 03 00 00 03 00 01 ..{3} ..",
                origin=captured,
            ),
            Command(
                name="resultant and taxels",
                request="55 AA 09 00 03 00 FB F0 03 00 00 7B 00 8C",
                reply="AA 55 85 00 03 00 FB F0 03 00 00 7B 00 01 ..{123} ..",
                origin=captured,
            ),
            Command(
                name="zero",
                request="55 AA 0A 00 03 00 79 03 00 00 00 01 00 01 76",
                reply="AA 55 0A 00 03 00 79 03 00 00 00 01 00 00 77",
                about="what the module feels now is zero from now on",
                origin=captured,
            ),
            Command(
                name="zero, off",
                request="55 AA 0A 00 03 00 79 03 00 00 00 01 00 00 77",
                reply="AA 55 0A 00 03 00 79 03 00 00 00 01 00 00 77",
                origin=tables,
            ),
        )

    def _refuse(self, packet: Broken) -> Outs:
        """A status, with whatever stands in the request's fields."""
        status = {"bad_length": BAD_LENGTH, "bad_checksum": BAD_LRC}[packet.why]
        return [_reply(_fields(packet), status)] if len(packet) >= SHORTEST - 1 else ()

    def _answer(self, packet: bytes) -> Outs:
        request = REQUEST.unpack(packet)
        assert request is not None, "the cutter has checked it"
        where, data = (request["address"], request["count"]), request["data"]
        module = self.module_at(request["device"])
        reads = request["function"] == READ
        if reads and where == (VERSION, VERSION_BYTES) and (request["device"] == 0 or module is not None):
            return [_reply(request, READ_DONE, self.version)]
        if module is None:
            self.counters["other_device"] += 1
            return ()
        if reads and not data and (content := self.memory(module, *where)) is not None:
            return [_reply(request, READ_DONE, content)]
        if request["function"] == WRITE and where == (ZERO, 1) and data in (b"\0", b"\1"):
            if data == b"\1":
                self.set_zero(module)
            return [_reply(request, WRITTEN)]
        self.counters["refused"] += 1
        return [_reply(request, _fault(request))]


def _fault(request: dict[str, Any]) -> int:
    """What is wrong with a sound request."""
    if request["function"] not in (READ, WRITE):
        return BAD_FUNCTION
    expected = request["count"] if request["function"] == WRITE else 0
    return BAD_LENGTH if len(request["data"]) != expected else BAD_ADDRESS


def _size(data: bytes) -> int | str:
    if len(data) < SHORTEST - 1:
        return MORE
    total = int.from_bytes(data[2:4], "little") + 5
    return total if SHORTEST <= total <= SHORTEST + LONGEST_DATA else "bad_length"


def _check(packet: bytes) -> str:
    return "bad_checksum" if lrc8(packet) else SOUND


def _fields(packet: bytes) -> dict[str, Any]:
    """What stands in a request's fields, sound or not."""
    device, _, function = packet[4:7]
    address, count = int.from_bytes(packet[7:11], "little"), int.from_bytes(packet[11:13], "little")
    return {"device": device, "function": function, "address": address, "count": count}


def _reply(request: dict[str, Any], status: int, data: bytes = b"") -> bytes:
    """The board's answer; it repeats the request's fields."""
    fields = {name: request[name] for name in ("device", "function", "address", "count")}
    return REPLY.pack(**fields, status=status, data=data)
