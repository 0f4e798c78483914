"""Loadstar DI-100U and DI-1000U: a load cell with its interface, which answers words with lines.

Wire: 230400 or 9600 8N1 (option ``baud``) through an FTDI bridge. A request ends with CR, an answer with CR LF.

    request   answer
    -         A               also ends the values of wc
    w         the load        three decimals, in the unit
    wc        the loads       unasked, until an empty request
    r         a whole number  of the converter
    tare      Tared           the present load becomes zero; forgotten at power-off
    model     text
    id        text
    unit      LB, Kg or N
    lc        the capacity    one decimal, in the unit
    others    E

Evidence: a driver, run.

Try it: ``tactemu run loadstar_di``, then ``loadstar_sensors_interface --high-speed --port PORT``.
"""

from typing import Annotated, Literal

from firmware_protocols import (
    MORE, USB, Column, Device, Option, Packets, Request, Serial, Transmissions, command, fact_table, points,
)  # fmt: skip

NEWTONS = {"LB": 4.4482216152605, "Kg": 9.80665, "N": 1.0}
DRIVER = "loadstar-sensors-interface 2.1.1"
FILE = f"{DRIVER} loadstar_sensors_interface.py"


class LoadstarDi(Device):
    """One load cell, asked or sending by itself."""

    name = "loadstar_di"
    title = "Loadstar DI-100U load cell"
    kind = "force-torque sensor"
    rate_hz = 100.0
    evidence = ("driver",)
    sources = (FILE,)
    judge = DRIVER
    origin = f"{FILE}, run"
    facts = fact_table(f"""
        stated touch: the load as a decimal number, in pounds, kilograms or newtons @ {FILE}:228-234, 267-277, 299-304
        assumed touch: the load has three decimals, the capacity one; the converter counts thousandths of the unit; a
            push is positive; the load saturates at the capacity @ {DRIVER}, all files
        stated identity: model, id and capacity; the answer A means accepted, E refused @ {FILE}:31-32, 255-265, 306-310
        assumed identity: the texts; an FTDI bridge @ {DRIVER}, all files
        stated configuration: an empty request ends wc; tare is answered with Tared or A @ {FILE}:29, 143, 163, 214-226
        assumed configuration: a request while the device streams is answered between two lines @ {DRIVER}, all files
        stated timing: 230400 or 9600 baud @ {FILE}:73-81
        assumed timing: 100 readings a second @ {DRIVER}, all files
    """)

    def __init__(
        self,
        *,
        baud: Annotated[Literal[230400, 9600], Option("speed of the interface")] = 230400,
        unit: Annotated[Literal["LB", "Kg", "N"], Option("unit of its loads")] = "LB",
        capacity: Annotated[float, Option("largest load, in the unit", low=0.1)] = 50.0,
        model: Annotated[str, Option("answer to model, ASCII")] = "DI-100U",
        ident: Annotated[str, Option("answer to id, ASCII")] = "F230001",
    ):
        self.layout = points({"cell": (0.0, 0.0, 0.0)})
        self.ports = (Serial(baud=baud, usb=USB(0x0403, 0x6001, node="ttyUSB")),)
        most, per_newton = round(1000 * capacity), 1000 / NEWTONS[unit]
        self.columns = (Column(name="load", unit="N", counts_per_unit=per_newton, low=-most, high=most, push=1),)
        self.texts = {"model": model, "id": ident, "unit": unit, "lc": f"{capacity:.1f}"}
        self.packets = Packets(b"", _size, counters=self.counters, longest=32)
        self.sending = False

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return a load, between wc and an empty request."""
        return [self._load()] if self.sending else ()

    def refused(self, request: Request, why: str) -> Transmissions:
        """Return the answer to another request."""
        return [b"E\r\n"]

    def _load(self) -> bytes:
        return b"%.3f\r\n" % (self.counts[0] / 1000)

    @command("0D", "41 0D 0A", name="stop")
    def stop(self, request: Request) -> bytes:
        """Stop the loads."""
        self.sending = False
        return b"A\r\n"

    @command(b"w\r", "..{5} 0D 0A", safe=True)
    def read(self, request: Request) -> bytes:
        """Return a load."""
        return self._load()

    @command(b"wc\r")
    def start(self, request: Request) -> None:
        """Start the loads."""
        self.sending = True

    @command(b"r\r", "* 0D 0A", safe=True)
    def converter(self, request: Request) -> bytes:
        """Return a number of the converter."""
        return b"%d\r\n" % self.counts[0]

    @command(b"tare\r", b"Tared\r\n")
    def tare(self, request: Request) -> bytes:
        """Make the present load zero."""
        self.zero = self.present
        return b"Tared\r\n"

    @command(b"model\r", b"DI-100U\r\n", safe=True, name="model")
    @command(b"id\r", b"F230001\r\n", safe=True, name="id")
    @command(b"unit\r", b"LB\r\n", safe=True, name="unit")
    @command(b"lc\r", b"50.0\r\n", safe=True, name="capacity")
    def text(self, request: Request) -> bytes:
        """Return a text."""
        return self.texts[request.packet[:-1].decode()].encode("ascii", "replace") + b"\r\n"


def _size(data: bytes) -> int:
    return data.find(b"\r") + 1 or MORE
