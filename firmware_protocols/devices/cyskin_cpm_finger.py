"""CPM-Finger, of the CySkin family: sixteen capacitive taxels and a proximity electrode, free running on CAN.

Wire: classic CAN, 1 Mbit/s, standard ids. The finger sends a scan of five frames every 28.08 ms, unasked.

    id                    data           about
    405, 407, 409, 40B    ``FOUR``       taxels 11 15 14 12, 9 13 8 10, 6 7 4 5, 2 0 3 1
    601                   ``NEAR``       proximity

Counts rise under a push; readers take a first scan as zero.

Evidence: two published readers, one of them run, and recordings of a fingertip that slides over fabric: a scan every
28.08 ms (26 to 30), means of 60 to 239 counts above zero under one grip, the second proximity always FFFF.

Try it: ``tactemu run cyskin_cpm_finger --port can:socketcan:vcan0``, then ``candump vcan0``.
"""

from dataclasses import replace
from typing import Annotated

import numpy as np

from firmware_protocols import Can, CanFrame, Column, Device, Frame, Option, Transmissions, fact_table, filled

FOUR = Frame("""
    four taxels
    0     <u2 x 4     touch
""")
NEAR = Frame("""
    proximity
    0     00 00       proximity     u16
    2     FF FF       second        not connected
""")
TAXEL_IDS = (0x405, 0x407, 0x409, 0x40B)
NEAR_ID = 0x601
WIRE_ORDER = (11, 15, 14, 12, 9, 13, 8, 10, 6, 7, 4, 5, 2, 0, 3, 1)
WIDTH_M = 0.012
LENGTH_M = 0.024
COUNTS_PER_NEWTON = 200.0
REST_COUNTS = 10_000


_DRIVER = "wngfra/fingerSense@a3e6926 tactile_sensor_driver.cc"
_SLIDE = "wngfra/FabricSlide@eceb771 data"


class CyskinCpmFinger(Device[CanFrame]):
    """A fingertip that transmits unasked."""

    name = "cyskin_cpm_finger"
    kind = "fingertip"
    title = "CySkin CPM-Finger, 16 taxels"
    ports = (Can(),)
    rate_hz = 1 / 0.02808
    evidence = ("driver",)
    sources = (
        "wngfra/can2wifi2ros@b429108 (the reader on an Arduino)",
        "wngfra/fingerSense@a3e6926 tactile_sensor_driver.cc",
        "wngfra/FabricSlide@eceb771 data (recordings: scan period, range)",
    )
    judge = "wngfra/fingerSense@a3e6926"
    facts = fact_table(f"""
        stated touch: the identifiers, and the order of frames and taxels; values have their low byte first @
            {_DRIVER}:35, 51-107; can2wifi2ros
        measured touch: counts were 60 to 239 above zero under one grip; the second proximity always read FFFF @
            {_SLIDE}
        assumed touch: {COUNTS_PER_NEWTON:.0f} counts/N, {REST_COUNTS} counts if untouched; the proximity is 0 @ both
            drivers; FabricSlide
        assumed touch: taxels are spread evenly over {WIDTH_M * 1000.0:.0f} x {LENGTH_M * 1000.0:.0f} mm; the table of
            frames names each of them @ both drivers
        stated configuration: 1 Mbit/s; the device transmits unasked, and no host sends to it @ {_DRIVER}:25
        assumed configuration: messages from the host are ignored @ both drivers send nothing
        measured timing: the finger is scanned every 28.08 ms (26 to 30) @ {_SLIDE}
    """)

    def __init__(
        self, *, rest: Annotated[int, Option("counts of an untouched taxel", low=0, high=0xFFFF)] = REST_COUNTS
    ):
        self.columns = (
            Column(name="touch", low=0, high=0xFFFF, rest=rest, assumed_per_unit=COUNTS_PER_NEWTON, push=1),
        )
        self.layout = replace(
            filled(len(WIRE_ORDER), WIDTH_M, LENGTH_M, name="finger"), wire_order=np.array(WIRE_ORDER)
        )

    def stream(self, t_ns: int, name: str) -> Transmissions[CanFrame]:
        """Return one scan: four frames of taxels and one of proximity."""
        taxels = zip(TAXEL_IDS, self.layout.on_wire(self.counts).reshape(len(TAXEL_IDS), -1))
        frames = [CanFrame(arbitration_id=ident, data=FOUR.pack(touch=touch)) for ident, touch in taxels]
        return [*frames, CanFrame(arbitration_id=NEAR_ID, data=NEAR.pack())]
