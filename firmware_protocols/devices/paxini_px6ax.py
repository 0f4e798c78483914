r"""PaXini PX-6AX tactile modules behind the GEN3 serial converter board.

Wire: 921600 8N1 through a CH343 bridge (1A86:55D3). Each request gets one reply; the board never transmits unasked. A
module answers to its number plus 1: a captured S1813E, and one that shared its line, to 3, an L5325 to 1. FF is the
broadcast: in this model a single module answers to it, several do not.

    action       function  address  count        data in the reply
    resultant    FB        0x3F0    3            Fx int8, Fy int8, Fz uint8, 0.1 N each
    taxels       FB        0x40E    3 n          the same per taxel
    both         FB        0x3F0    30 + 3 n     taxels start at +30
    version      FB        6100     100          ASCII, padded with 00; holds the module's part code
    zero         79        3        1            none; 01 makes the present value zero, 00: accepted, changes nothing

Real boards answer reads with status 01 although the data are good, and writes with 00; other codes as the GEN2 box. The
vendor's viewer and PaXini's application ignore the status, paxini-sdk accepts 00 and 01; fengjh97/paxini accepts 00
only, as in the vendor's example in C, and reads nothing unless ``read_status=0``. It notes that another official
example takes data from offset 13; the viewer takes 14.

Try it: ``tactemu run paxini_px6ax``, then ``SingleSensorBoard(port, device_id=3, sensor="PXSR-STDDP03F")`` of
``paxini_sdk``.
"""

import struct
from typing import Annotated

from firmware_protocols import (
    MORE, USB, Broken, Frame, Option, Packets, Refused, Request, Serial, Transmissions, command, command_table,
    fact_table,
)  # fmt: skip
from firmware_protocols.devices.paxini_modules import GAP_NS, Model, Px6axDevice

REQUEST = Frame("""
    request
    0     55 AA       head
    2     <u2         length = total - 5
    4     u1          device                number of the module
    5     u1          reserved              00; ignored
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
MIN_REQUEST_BYTES = 14
MAX_DATA_BYTES = 64
VERSION_ADDRESS = 6100
VERSION_BYTES = 100
ZERO_ADDRESS = 3
BROADCAST = 0xFF

WRITTEN = 0
READ_DONE = 1
BAD_LENGTH = 1
BAD_ADDRESS = 6
FAULTS = {"bad_length": BAD_LENGTH, "bad_checksum": 2, "unknown_command": 3}
FIELDS = struct.Struct("<BxBIH")
"""Device, function, address and count of a request."""
PART_CODES = {
    "L3530": "DP03A", "M2826": "DP03B", "S2716": "DP03C", "S1813C": "DP03D", "S3013": "DP03E", "S1813E": "DP03F",
    "S2015": "DP03G", "M2324": "IP03A", "S1610": "IP03B", "L5325": "CP03A", "M3025": "CP03B", "M2020": "MC03A",
}  # fmt: skip
"""The part code of each model, without PXSR-STD; hosts find the model by it in the version text."""

TOOLKIT = "yknxh/paxini-toolkit@1596843"
ROS2 = "adnan-saood/paxini_ros2@25009ba"


class PaxiniPx6ax(Px6axDevice):
    """Modules behind a GEN3 converter board, which answers requests."""

    name = "paxini_px6ax"
    title = "PaXini PX-6AX, GEN3 serial converter board"
    kind = "fingertip"
    ports = (Serial(baud=921600, usb=USB(0x1A86, 0x55D3, "", "USB-Enhanced-SERIAL CH343", node="ttyUSB")),)
    rate_hz = 1000 / 12
    evidence = ("captured", "driver")
    sources = (
        "yknxh/paxini-toolkit@1596843 tests/test_codec.py (captured frames), codec.py SENSOR_TYPES, sim.py (status 01)",
        "paxini-sdk 0.1.0 boards/serial_converter.py, data/registry.json (part codes)",
        "fengjh97/paxini@e8e6bcc paxini_sensor.py l.16-29",
        f"{TOOLKIT} paxkit/device/usb.py, transport.py",
        f"{ROS2} paxini_hardware/src/tactile_sensor.cpp, config/sensors.yaml; helper_scripts/UI_sensor.py",
    )
    judge = "paxini-sdk 0.1.0, lerobot-robot-so101-paxini 0.1.0, fengjh97/paxini@e8e6bcc"
    documented = command_table("""
        @ yknxh/paxini-toolkit@1596843 tests/test_codec.py
        ? version             55 AA 09 00 03 00 FB D4 17 00 00 64 00 AB
            AA 55 6E 00 03 00 FB D4 17 00 00 64 00 01 50 41 58 49 4E 49 20 ..{93} ..
        ? resultant           55 AA 09 00 03 00 FB F0 03 00 00 03 00 04
            AA 55 0D 00 03 00 FB F0 03 00 00 03 00 01 ..{3} ..
        ? resultant and taxels  55 AA 09 00 03 00 FB F0 03 00 00 7B 00 8C
            AA 55 85 00 03 00 FB F0 03 00 00 7B 00 01 ..{123} ..
        zero                  55 AA 0A 00 03 00 79 03 00 00 00 01 00 01 76
            AA 55 0A 00 03 00 79 03 00 00 00 01 00 00 77  the present force becomes zero
        @ paxini-sdk 0.1.0 serial_converter.py
        zero, off             55 AA 0A 00 03 00 79 03 00 00 00 01 00 00 77  AA 55 0A 00 03 00 79 03 00 00 00 01 00 00 77
    """)
    facts = fact_table(f"""
        stated identity: USB 1A86:55D3 @ {TOOLKIT} paxkit/device/transport.py l.11 (seen on a real one)
        stated identity: the port's description contains CH343 @ fengjh97/paxini@e8e6bcc paxini_sensor.py l.207
        measured identity: S1813E: PAXINI PXSR-STDDP03F-v1.0.5 @ {TOOLKIT} tests/fixtures/usb_S1813E_2026-10-04
        measured identity: of the addresses 0 to 8 it answered to 3 @ {TOOLKIT} tests/test_usb_capture.py, test_codec.py
        stated identity: address 3 is common; FF is a broadcast @ lerobot-camera-paxini 0.1.0 configuration_paxini.py
            l.39
        stated identity: the address is the module's number plus 1 @ {ROS2} tactile_sensor.cpp l.117; sensors.yaml
        measured configuration: reads are answered with status 01 @ paxini-sdk 0.1.0 serial_converter.py l.167 (a
            PXSR-STDDP03A)
        stated touch: forces are in 0.1 N; x and y are int8, z is uint8 @ {ROS2} helper_scripts/UI_sensor.py (the
            vendor's)
        assumed identity: manufacturer and product text of the bridge @ transport.py, paxini_sensor.py
        assumed identity: the addresses of other models and of further modules are 1, 2 ... @ {ROS2} sensors.yaml;
            paxini-sdk 0.1.0
        assumed touch: taxels lie in rows on a flat pad; the true places are in paxini-sdk data/ and are not used yet @
            {ROS2}
        assumed touch: the resultant is the sum over the pad; axes along the pad @ UI_sensor.py; {TOOLKIT} codec.py
        assumed configuration: the status is 1 for a wrong length, 2 LRC, 3 function, 6 address, as on GEN2 @ paxini-sdk
            0.1.0 protocol.py
        assumed configuration: PaXini's command that changes the address (35) is not modelled @ {TOOLKIT} codec.py
        assumed timing: a conversion every 12 ms; an incomplete request is discarded after 50 ms @ {TOOLKIT} usb.py,
            sim.py
    """)

    def __init__(
        self,
        *,
        models: Annotated[Model | tuple[Model, ...], Option("one model name, or several")] = "S1813E",
        places: Annotated[
            tuple[int, ...] | None,
            Option("address of each module; default: 3 for one S1813E, else 1, 2 ..."),
        ] = None,
        version: Annotated[str | None, Option("text at address 6100; default: part code of the model")] = None,
        read_status: Annotated[int, Option("status of a good read: 1 as captured, or 0", low=0, high=1)] = READ_DONE,
    ):
        several = () if isinstance(models, str) else models
        self._power_up(models, places or ((3,) if models == "S1813E" else range(1, 1 + max(1, len(several)))))
        self.read_status = read_status
        texts = (version or f"PAXINI PXSR-STD{PART_CODES[model]}-v1.0.5" for model in self.models)
        self.versions = [text.encode("ascii")[:VERSION_BYTES].ljust(VERSION_BYTES, b"\0") for text in texts]
        self.packets = Packets(REQUEST, _size, by="function", counters=self.counters, gap_ns=GAP_NS, broken=True)
        self.packets.others = "other_device"

    def accepts(self, request: Request) -> bool:
        """Return True for a request to one of the modules."""
        is_only = request.device == BROADCAST and len(self.models) == 1
        request.module = 0 if is_only else self.module_at(request.device)
        return request.module is not None

    @command(on=0xFB)
    def read(self, request: Request):
        """Return the version, or memory of a module."""
        where = request.address, request.count
        version = self.versions[request.module] if where == (VERSION_ADDRESS, VERSION_BYTES) else None
        content = version or self.memory(request.module, *where)
        if request.data or content is None:
            raise Refused("value" if request.data else "address")
        return self._answer(request.packet, self.read_status, content)

    @command(on=0x79)
    def write(self, request: Request):
        """Make the present force zero, or accept without effect."""
        if (request.address, request.count) != (ZERO_ADDRESS, 1) or request.data not in (b"\0", b"\1"):
            raise Refused("value" if len(request.data) != request.count else "address")
        if request.data == b"\1":
            self.set_zero(request.module)
        return self._answer(request.packet, WRITTEN)

    def refused(self, request: Request, why: str) -> Transmissions:
        """Return a reply with a status and the fields of the request, also if it is broken."""
        if isinstance(packet := request.packet, Broken) and (
            len(packet) < MIN_REQUEST_BYTES - 1 or self.module_at(packet[4]) is None
        ):
            return ()
        return self._answer(packet, FAULTS.get(why, BAD_LENGTH if request.why == "value" else BAD_ADDRESS))

    def _answer(self, packet: bytes, status: int, data: bytes = b"") -> list[bytes]:
        device, function, address, count = FIELDS.unpack_from(packet, 4)
        return [REPLY.pack(device=device, function=function, address=address, count=count, status=status, data=data)]


def _size(data: bytes) -> int | str:
    return REQUEST.length_of(data, MAX_DATA_BYTES) if len(data) >= MIN_REQUEST_BYTES - 1 else MORE
