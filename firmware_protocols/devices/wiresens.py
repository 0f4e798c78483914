r"""WiReSens: a matrix of resistive taxels read by a small wireless board, here on its serial port.

Wire: 250000 8N1. Text first, as the board starts; it then waits for its configuration, JSON on a line or before a
second of silence, or has one in its memory (option ``saved``), and streams ``PACKET`` s. From then on it ignores its
input. Of the configuration it takes ``id`` and ``numNodes``, values in a packet; ``startCoord`` and ``endCoord`` must
be those of the matrix: [read wire, ground wire] is [column, row].

A packet is full before it is sent: the remainder of a scan is at the head of the next scan's first packet. A push
lowers a value, from 2.5 V of 3.3 V down to 0.

The receiver splits the stream at 77 72 ("wr") and drops pieces of another length. So a packet with 77 72 elsewhere is
lost: each with that in its number, 29303 the first; and the first packet, behind the text. From then on each of its
scans consists of parts of two, as it counts values and ignores their start.

Try it: ``tactemu run wiresens values=120``, then the ``SerialReceiver`` of WiReSensPy.
"""

import json
from typing import Annotated

import numpy as np

from firmware_protocols import Column, Device, Frame, Option, Rollover, Serial, Transmissions, fact_table, grid_layout

PACKET = Frame("""
    packet
    0     i1               sensor
    1     <u2              start      index of the first value, row by row
    3     <u2 x values     touch
    ..    <u4              number     of the packet
    ..    77 72            end        wr
""")
REST_COUNTS = 3103
SILENCE_NS = 1_000_000_000
MAX_CONFIGURATION_BYTES = 4096
WAITING = b"Building kit\r\nWaiting for serial input...\r\n"
SAVED = b"Loaded data from EEPROM\r\n"
TAKEN = b"JSON String saved to EEPROM\r\n"
READY = b"Initializing Toolkit\r\nSet Resistance to 31250.00\r\n"
PYTHON = "WiReSens-Toolkit/WiReSensPy@2e9297c"
FIRMWARE = "WiReSens-Toolkit/WiReSensToolkit-Arduino@e3cb34a"
CPP = f"{FIRMWARE} src/WiSensToolkit.cpp"
BOTH = "WiSensToolkit.cpp, WiSensToolkit.h, GenericReceiver.py, Sensor.py, TouchSensorWireless.py, utils.py (all whole)"


class Wiresens(Device):
    """A matrix that streams packets of equal length."""

    name = "wiresens"
    kind = "fingertip"
    ports = (Serial(baud=250_000),)
    rate_hz = 30.0
    evidence = ("firmware", "driver")
    sources = (f"{CPP} (the board's firmware)", f"{PYTHON} GenericReceiver.py, Sensor.py, utils.py")
    judge = PYTHON
    facts = fact_table(f"""
        stated touch: values are sent row by row; y is the ground wire, x the read wire @ {CPP}:566-640
        stated touch: the remainder of a scan is at the start of the next packet @ {CPP}:566-640; {PYTHON}
            Sensor.py:86-104
        stated touch: a push lowers the value; 0 is saturation @ {CPP}:509-522
        stated touch: 2.5 V is the value without a push, 3.3 V are 4096 counts @ {CPP}:523-530
        assumed touch: 16 x 16 taxels, 5 mm apart; a push of 1 N halves the value, linearly @ {BOTH}
        stated identity: sensor id 1 as shipped @ {PYTHON} WiSensConfigClean.json, WiSensConfig.json
        stated configuration: a line of JSON sets the id and the number of values in a packet @ {CPP}:98-131
        stated configuration: the host sends this line without an end of line @ {PYTHON} utils.py:69
        stated configuration: the text that the board prints first @ {CPP}:78-117, 282
        stated configuration: 120 values in a packet as shipped @ {PYTHON} WiSensConfigClean.json
        assumed configuration: 64 values by default, so that whole packets fill 16 x 16 @ {BOTH}
        assumed configuration: a matrix of another size is refused; intermittent sending is not modelled @ {BOTH}
        stated timing: 250000 baud @ {FIRMWARE} README.md; {PYTHON} WiSensConfigClean.json
        stated timing: packets are numbered from 0 @ {FIRMWARE} src/WiSensToolkit.h:559
        assumed timing: 30 scans a second @ {BOTH}
    """)

    def __init__(
        self,
        *,
        rows: Annotated[int, Option("rows of the matrix", low=1, high=64)] = 16,
        cols: Annotated[int, Option("columns of the matrix", low=1, high=64)] = 16,
        values: Annotated[int, Option("values in a packet, as in the configuration", low=1, high=120)] = 64,
        sensor: Annotated[int, Option("number of the sensor", low=-128, high=127)] = 1,
        half_force: Annotated[float, Option("push that halves the value", unit="N", low=1e-6)] = 1.0,
        saved: Annotated[bool, Option("the board has its configuration in memory, and waits for none")] = True,
    ):
        self.title = f"WiReSens {rows} x {cols} tactile matrix"
        self.layout = grid_layout(rows, cols, 0.005, name="matrix")
        scale = REST_COUNTS / (2 * half_force)
        self.columns = (
            Column(name="touch", low=0, high=REST_COUNTS, rest=REST_COUNTS, assumed_per_unit=scale, push=-1),
        )
        self.sensor, self.number = sensor, 0
        self.last = [cols - 1, rows - 1]
        self.packet, self.values, self.saved, self.running = PACKET.bind(values=values), values, saved, saved
        self.rollovers = (Rollover(name="number", bits=32, step=max(1, rows * cols // values), state="number"),)
        self.kept, self.text = np.zeros(0, np.int64), b""

    def boot(self, t_ns: int) -> Transmissions:
        """Return the text of the start-up."""
        return [WAITING + SAVED + READY if self.saved else WAITING]

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return the packets that this scan fills."""
        if not self.running:
            return ()
        values = np.concatenate([self.kept, self.layout.on_wire(self.counts)])
        n = len(values) // self.values
        starts = (np.arange(n) * self.values - len(self.kept)) % len(self.layout)
        touch, self.kept = np.split(values, [n * self.values])
        numbers = (self.number + np.arange(n)) & 0xFFFFFFFF
        self.number = (self.number + n) & 0xFFFFFFFF
        touch = touch.reshape(n, self.values)
        return self.packet.pack_many(n, sensor=self.sensor, start=starts, touch=touch, number=numbers)

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Take the configuration, while the board waits for one."""
        if self.running:
            self.counters["ignored"] += 1
            return ()
        line, ended, _ = (self.text + data).partition(b"\n")
        self.text, self.wake_ns = line[:MAX_CONFIGURATION_BYTES], None if ended else t_ns + SILENCE_NS
        return self._configure() if ended else ()

    def wake(self, t_ns: int) -> Transmissions:
        """Take the configuration that a second of silence has ended."""
        return self._configure()

    def _configure(self) -> Transmissions:
        text, self.text = self.text, b""
        if not text:
            return ()
        try:
            configuration = json.loads(text)
            sensor, values = int(configuration["id"]), int(configuration["numNodes"])
            fits = [list(configuration[name]) for name in ("startCoord", "endCoord")] == [[0, 0], self.last]
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
            self.counters["bad_request"] += 1
            return [b"deserializeJson() failed: InvalidInput\r\n"]
        if not (fits and 1 <= values <= 120 and -128 <= sensor <= 127):
            self.counters["refused"] += 1
            return ()
        self.counters["requests"] += 1
        self.sensor, self.values, self.packet, self.running = sensor, values, PACKET.bind(values=values), True
        return [TAKEN + READY]
