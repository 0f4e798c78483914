r"""Fulai tactile glove: eight zones of resistive taxels, three versions of the hardware, left and right.

Wire: serial at 2 000 000 8N1, DTR set. It streams from power-up: float32 little-endian, ADC counts 0..4095, then the
"JustFloat" tail, a float infinity (``FRAME``). The number of floats gives the version:

    hardware  floats  thumb  each finger  palm  thenar  hypothenar
    3.0       415     50     50           42    45      78
    3.1       401     50     50           42    37      72
    3.2       615     82+8   90           42    38+7    78        +8, +7: slots behind the zone that hold no taxel

Zones follow in this order, each row by row from the fingertips, left to right; those of a left hand's palm, thenar and
hypothenar right to left. Rows get narrower at the edges (``FINGER_ROWS`` ...).

Text to the glove, lines ended by CR LF:

    line               answer
    vofa off           - (stops the stream)
    vofa on            - (resumes the stream)
    bridge info get    OK BRIDGE MODEL=FuLai_SensorGlove FW= HW= PROTOCOL= HAND= HAND_DEFAULT= HAND_SOURCE= IAP=
    any other          ERR unknown command

Old firmware does not support the third (``identity=false``): the user of the driver then gives hand and version, or the
driver finds the version by the length of three frames. No checksum. The driver does the taring (30 frames) and the
scaling to newtons. A 0 before a taxel at 1022 or 4088 forms the tail inside a frame: the driver drops that frame.

Try it: ``tactemu run fulai_glove``, then ``tactile-stream PORT G-001 left``.
"""

from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Column, Counts, Device, Frame, HalfForce, Layout, Lines, Option, Patch, Reading, Request, Serial, Transmissions,
    command, fact_table, quantize, stack,
)  # fmt: skip

FRAME = Frame("""
    frame
    0     <f4 x slots     adc    0..4095, zone after zone
    ..    00 00 80 7F     tail   float infinity
""")
UNKNOWN_COMMAND = b"ERR unknown command\r\n"
ADC_MAX = 4095
SDK = "fulai-tactile 1.0.5"

Rows = tuple[tuple[int, int], ...]
"""The first column and the number of taxels of each row, of a left hand seen from its palm, fingers up."""
FINGER_ROWS: Rows = ((2, 4), (1, 6))
PALM_ROWS: Rows = ((0, 14),) * 3
THENAR_ROWS: dict[str, Rows] = {
    "3.0": ((0, 3), (0, 5), (0, 5), (0, 6), (0, 6), (0, 6), (1, 5), (2, 4), (2, 3), (3, 2)),
    "3.1": ((0, 2), (0, 3), (0, 4), (0, 5), (0, 5), (0, 5), (0, 5), (1, 4), (1, 3), (2, 1)),
    "3.2": ((0, 2), (0, 3), (0, 4), (0, 5), (0, 5), (0, 5), (0, 5), (1, 4), (1, 3), (2, 2)),
}
HYPOTHENAR_ROWS_31: Rows = ((4, 6), (3, 7), (3, 7), (2, 7), (2, 7), (2, 7), (1, 8), (1, 7), (0, 8), (0, 8))
HYPOTHENAR_ROWS: Rows = ((3, 7), (3, 7), (2, 8), (2, 8), (2, 7), (1, 8), (1, 8), (0, 9), (0, 8), (0, 8))
SLOTS_32 = {"thumb": 90, "thenar": 45}
"""The slots of the zones of hardware 3.2 that have more slots than taxels."""

ZONE_CENTRES_M = {
    "thumb": (-0.060, 0.040), "index": (-0.032, 0.090), "middle": (-0.010, 0.100), "ring": (0.012, 0.092),
    "little": (0.034, 0.075), "palm": (0.0, 0.040), "thenar": (-0.022, 0.0), "hypothenar": (0.022, 0.0),
}  # fmt: skip
"""The middle of each zone of a left hand, seen from its palm, fingers up."""
FINGERS = tuple(ZONE_CENTRES_M)[:5]
FINGER_PITCH_M = 0.002
PALM_PITCH_M = 0.004


class FulaiGlove(Device):
    """A glove that streams floats and answers a request for its identity."""

    name = "fulai_glove"
    kind = "glove"
    ports = (Serial(baud=2_000_000),)
    evidence = ("driver",)
    sources = ("fulai-tactile 1.0.5 decoder.py, identity.py, layout.py, transport.py (the vendor's own)",)
    judge = "fulai-tactile 1.0.5"
    origin = "fulai-tactile 1.0.5 identity.py, session.py"
    documented_with = ("hardware", "hand", "firmware", "baseline", "half_force")
    facts = fact_table(f"""
        stated identity: the answer and its fields: FW=3.5.0, PROTOCOL=1.5, FLASH, IAP=1 @ {SDK} test_identity.py l.10
        stated identity: old firmware: ERR unknown command @ {SDK} test_identity.py l.77 (the vendor's own stand-in)
        stated identity: its port is a /dev/ttyACM* or ttyUSB* @ {SDK} transport.py l.178
        stated touch: the frames of each hardware version, and their slots without a taxel @ {SDK} layout.py; README
        stated timing: 100 frames a second, 100 counts untouched @ {SDK} types.py l.175 (its simulation)
        assumed touch: taxels are 2 mm apart on a finger and 4 mm elsewhere; row 0 is at the fingertips @ {SDK}
            layout.py
        assumed touch: ADC = rest + (4095 - rest) F / (F + 1 N); slots without a taxel read 0
        assumed configuration: vofa on and off get no answer; unknown lines are answered with ERR @ {SDK} session.py,
            tests
        assumed configuration: the glove streams from power-up, with or without DTR @ {SDK} session.py, transport.py
        assumed timing: hardware 3.2 sends 80 frames a second, as one of its frames takes 12.3 ms
    """, looked=f"{SDK} whole")  # fmt: skip

    def __init__(
        self,
        *,
        hardware: Annotated[Literal["3.0", "3.1", "3.2"], Option("version")] = "3.1",
        hand: Annotated[Literal["left", "right"], Option("hand that the glove fits")] = "left",
        identity: Annotated[bool, Option("answers `bridge info get`; old firmware does not")] = True,
        firmware: Annotated[str, Option("version in the identity, without spaces")] = "3.5.0",
        baseline: Annotated[int, Option("ADC value of an untouched taxel", low=0, high=ADC_MAX - 1)] = 100,
        half_force: HalfForce = 1.0,
    ):
        self.title = f"Fulai tactile glove V{hardware}, {hand}"
        self.rate_hz = 80.0 if hardware == "3.2" else 100.0
        zones = _zones(hardware)
        self.layout = stack(*(_zone(name, rows, hand) for name, rows in zones.items()))
        self.slots, floats = _slots(zones, hardware)
        self.frame, self.floats = FRAME.bind(slots=floats), np.zeros(floats, np.float32)
        self.columns = (Column(name="adc", low=baseline, high=ADC_MAX, rest=baseline, push=1),)
        self.baseline, self.half_force = baseline, half_force
        answer = (
            f"OK BRIDGE MODEL=FuLai_SensorGlove FW={firmware} HW={hardware} PROTOCOL=1.5 "
            f"HAND={hand.upper()} HAND_DEFAULT=RIGHT HAND_SOURCE=FLASH IAP=1\r\n"
        ).encode("ascii")
        self.answer = answer if identity else UNKNOWN_COMMAND
        self.packets, self.streaming = Lines(counters=self.counters), True

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return ADC counts of each taxel, zone after zone."""
        push = np.maximum(self.layout.push(reading["force"]), 0.0)
        self.counts = quantize(push / (push + self.half_force), ADC_MAX - self.baseline, 0, ADC_MAX, self.baseline)
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one frame, unless the stream was stopped."""
        self.floats[self.slots] = self.layout.on_wire(self.counts)
        return [self.frame.pack(adc=self.floats)] if self.streaming else ()

    @command(b"vofa off\r\n")
    def stop(self, request: Request):
        """Stop the stream."""
        self.streaming = False

    @command(b"bridge info get\r\n", f"{b'OK BRIDGE MODEL='.hex()} *", safe=True)
    def identity(self, request: Request):
        """Return what it is; old firmware does not know."""
        return self.answer

    @command(b"vofa on\r\n")
    def go_on(self, request: Request):
        """Resume the stream."""
        self.streaming = True

    def refused(self, request: Request, why: str) -> Transmissions:
        """Return that a line is unknown."""
        return [UNKNOWN_COMMAND]


def _zones(hardware: str) -> dict[str, Rows]:
    """Return the rows of each zone by name, in wire order."""
    full_rows = dict.fromkeys(FINGERS, 10 if hardware == "3.2" else 5)
    if hardware == "3.2":
        full_rows["thumb"] = 9
    fingers = {name: FINGER_ROWS + ((0, 8),) * rows for name, rows in full_rows.items()}
    hypothenar = HYPOTHENAR_ROWS_31 if hardware == "3.1" else HYPOTHENAR_ROWS
    return {**fingers, "palm": PALM_ROWS, "thenar": THENAR_ROWS[hardware], "hypothenar": hypothenar}


def _slots(zones: dict[str, Rows], hardware: str) -> tuple[np.ndarray, int]:
    """Return the slot of each taxel's float in a frame, and the number of floats in a frame."""
    taxels = {name: sum(count for _, count in rows) for name, rows in zones.items()}
    spans = taxels | SLOTS_32 if hardware == "3.2" else taxels
    starts = np.cumsum([0, *spans.values()])
    return np.concatenate([start + np.arange(n) for start, n in zip(starts, taxels.values())]), int(starts[-1])


def _zone(name: str, rows: Rows, hand: str) -> Layout:
    """Return one zone, with its taxels in the order of their numbers."""
    finger, mirrored = name in FINGERS, -1 if hand == "right" else 1
    cells = np.array(
        [(col, row) for row, (first, n) in enumerate(rows) for col in range(first, first + n)[:: 1 if finger else -1]]
    )
    pitch = FINGER_PITCH_M if finger else PALM_PITCH_M
    x, y = (pitch * (cells - cells.max(axis=0) / 2)).T
    middle_x, middle_y = ZONE_CENTRES_M[name]
    places = np.stack([mirrored * middle_x + (x if finger else mirrored * x), middle_y - y, 0 * x], axis=-1)
    patch = Patch(name=name, start=0, rows=0, cols=len(places), pitch=pitch, link=name if finger else "palm")
    return Layout(positions=places, normals=np.array([0.0, 0.0, 1.0]), patches=(patch,))
