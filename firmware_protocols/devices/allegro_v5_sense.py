"""Wonik Allegro Hand V5 Sense: sixteen pressure channels on CAN, touch alone.

Wire: classic CAN, standard ids, which are the numbers of the vendor's driver times four.

    id    number   data       direction   about
    150   54       ``EIGHT``  to host     channels 0 to 7
    154   55       ``EIGHT``  to host     channels 8 to 15
    204   81       -          to hand     periods of what it sends; what they mean here is not known: not looked at
    200   80       remote     to hand     information; 220 (number 88) serial number: answers not known, silence

Channel 0 is the palm; 3, 7, 11 and 15 are the fingertips of index, middle, ring and thumb; the others lie on the links
between. The driver multiplies a byte by 4, takes FF as invalid and shows it as 0, low-passes and divides by 10.

Not modelled, since no table of them was at hand: joints, and the older frames 158 and 15C (four u16 each, big-endian).

Evidence: the vendor's ROS driver, read and not run.

Try it: ``tactemu run allegro_v5_sense --port can:socketcan:vcan0``, then ``candump vcan0``.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from firmware_protocols import Can, CanFrame, Column, Counts, Device, Option, Outs, Reading, points
from firmware_protocols.adc import quantize
from firmware_protocols.layouts import stack
from firmware_protocols.tables import Frame

EIGHT = Frame("""
    eight channels
    0     u1 x 8     channels     0 to 254, FF invalid
""")
IDS = (0x150, 0x154)
INVALID = 0xFF
FINGERS = ("index", "middle", "ring", "thumb")
PITCH, SPACING, COUNTS_PER_NEWTON = 0.018, 0.03, 25.0


def places() -> dict[str, tuple[str, float, float]]:
    """Link and x, y [m] of each channel by its name, in order: four of a finger, of the first the palm in front."""
    found = {"palm": ("palm", 0.0, -0.06)}
    for k in range(1, 4 * len(FINGERS)):
        finger, part = FINGERS[k // 4], k % 4
        found[f"{finger} {'tip' if part == 3 else part}"] = (finger, (k // 4 - 1.5) * SPACING, part * PITCH)
    return found


class AllegroV5Sense(Device[CanFrame]):
    """Channels that are sent unasked."""

    name = "allegro_v5_sense"
    kind = "hand"
    title = "Wonik Allegro Hand V5 Sense, touch"
    ports = (Can(),)
    evidence = ("driver",)
    sources = ("Wonikrobotics-git/allegro_hand_ros2_V5_Sense@db81588 AllegroHandDrv.cpp l.417, candef.h",)
    judge = "cantools, with a DBC of its frames; own second reader"
    assumed = (
        f"{COUNTS_PER_NEWTON:.0f} counts/N; sent 100 times a second from power-up on; 1 Mbit/s",
        "which finger has which tip; the channels between lie on the finger whose tip follows",
        f"a point each, {PITCH * 1e3:.0f} mm apart along a finger, fingers {SPACING * 1e3:.0f} mm apart, in one plane",
    )

    def __init__(self, *, invalid: Annotated[tuple[int, ...], Option("channels that say FF", low=0, high=15)] = ()):
        self.layout = stack(
            *(points({name: (x, y, 0.0)}, pitch=0.012, link=link) for name, (link, x, y) in places().items())
        )
        self.invalid = list(invalid)
        self.columns = (Column(name="channel", low=0, high=0xFE, push=0 if invalid else 1),)

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """Raw counts of the normal force of each channel, 0..254; 0 of an invalid one; shape ``(16,)``."""
        self.counts = quantize(self.layout.push(reading["force"]), COUNTS_PER_NEWTON, 0, 0xFE)
        self.counts[self.invalid] = 0
        return self.counts

    def stream(self, t_ns: int, name: str) -> Outs[CanFrame]:
        """Both frames."""
        sent = self.layout.on_wire(np.where(np.isin(np.arange(16), self.invalid), INVALID, self.counts))
        eights = zip(IDS, sent.reshape(2, 8))
        return [CanFrame(arbitration_id=ident, data=EIGHT.pack(channels=eight)) for ident, eight in eights]
