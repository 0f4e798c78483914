"""AgiBot OmniHand Pro 2025 (O12) and OmniHand 2025 (O10): CAN-FD hands whose fingers are asked one by one for touch.

Wire: CAN-FD, 29-bit identifiers ``ppppp 00000101 00000001 w ddddddd`` (p part, w write, d number of the hand). A driver
sends 64 bytes, which nobody looks at; the part answers under the same identifier with the write bit clear. A driver
waits 50 ms.

Parts 1..5 are the fingers; 6 and 7, of an O10, its palm and its back. A hand tells of errors unasked, with 00100000,
00100001 (temperature) or 00100010 (current) in place of 00000101; what they hold is not known, and none is sent.

Evidence: the vendor's SDK. It has decoded frames of the Pro that were built by hand; of the O10 its source was read.

Try it: ``tactemu run agibot_omnihand_pro --port can:socketcan:vcan0``, then
``candump vcan0 & cansend vcan0 01050101##1$(printf '00%.0s' {1..64})``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar

import numpy as np

from firmware_protocols import Can, CanFrame, Column, Command, Counts, Device, Option, Outs, Reading, grid_layout
from firmware_protocols.adc import quantize
from firmware_protocols.layouts import stack
from firmware_protocols.tables import Frame, Identifier

IDENT = Identifier("ppppp0000010100000001wddddddd", {"part": "p", "write": "w", "device": "d"})

FINGERS = ("thumb", "index", "middle", "ring", "little")
PLACES = {name: ((k - 2) * 0.025, 0.0, 0.0) for k, name in enumerate(FINGERS)}
PLACES |= {"palm": (-0.025, -0.06, 0.0), "back": (0.025, -0.06, 0.0)}
PITCH = 0.004
COUNTS_PER_NEWTON, PRO_COUNTS_PER_NEWTON = 50.0, 1000.0


class AgibotOmniHand(Device[CanFrame]):
    """Parts that answer one request each."""

    kind = "hand"
    evidence = ("driver",)
    assumed = (
        "1 Mbit/s, 5 Mbit/s for data, number 1; of the parts: 1 the thumb; the O10's identifiers, as the Pro's",
        f"a square of channels on each part, row by row, {PITCH * 1e3:.0f} mm apart, all facing one way, tips to +y",
        f"{COUNTS_PER_NEWTON:.0f} counts/N of normal force (Pro: {PRO_COUNTS_PER_NEWTON:.0f}); 100 Hz",
        "answers are filled with zeros to the next length of CAN-FD; whatever else is sent gets silence",
    )
    parts: ClassVar[Mapping[str, int]]
    """Channels along a side, by name from part 1 on."""
    answers: ClassVar[Mapping[int, Frame]]
    """By channels along a side."""
    counts: np.ndarray

    def __init__(self, *, device: Annotated[int, Option("its number on the bus", low=0, high=127)] = 1):
        self.device = device
        self.ports = (Can(data_bitrate=5_000_000, hears=(IDENT.filter(device=device),)),)
        self.layout = stack(
            *(grid_layout(n, n, PITCH, name=p, origin=PLACES[p], link=p) for p, n in self.parts.items())
        )

    def receive(self, data: CanFrame, t_ns: int, port: str) -> Outs[CanFrame]:
        """Answer a request for the touch of one part."""
        asked = IDENT.read(data.arbitration_id) if data.is_extended_id and data.is_fd else None
        if asked is None or asked["device"] != self.device:
            self.counters["ignored"] += 1
            return ()
        part = asked["part"]
        if not 1 <= part <= len(self.parts):
            self.counters["unknown_command"] += 1
            return ()
        self.counters["requests"] += 1
        ident, patch = IDENT.of(part=part, write=0, device=self.device), self.layout.patches[part - 1]
        touch = self._answer(self.answers[patch.rows], self.layout.on_wire(self.counts)[patch.taxels])
        return [CanFrame(arbitration_id=ident, data=touch, is_extended_id=True, is_fd=True, bitrate_switch=True)]

    def _answer(self, table: Frame, counts: np.ndarray) -> bytes:
        """What a part with these counts says."""
        return table.pack(channels=counts)

    @property
    def commands(self) -> tuple[Command, ...]:
        """A request for each part."""
        idents = [f"{IDENT.of(part=k, write=0, device=self.device):08X}" for k in range(1, len(self.parts) + 1)]
        return tuple(
            Command(name=part, request=f"{ident}##1{'00' * 64}", reply=f"{ident}##1 *", origin=self.sources[0])
            for ident, part in zip(idents, self.parts)
        )


class AgibotOmniHandO10(AgibotOmniHand):
    """O10: 16 taxels a finger, 25 on the palm and on the back."""

    name = "agibot_omnihand_o10"
    title = "AgiBot OmniHand 2025 (O10)"
    columns = (Column(name="channel", low=0, high=0xFF, push=1),)
    sources = ("AgibotTech/Omnihand-2025-SDK@bcbccf4",)
    judge = "own second reader"
    parts = {**dict.fromkeys(FINGERS, 4), "palm": 5, "back": 5}
    answers = {
        4: Frame("""
            finger, row by row, id ppppp 00000101 00000001 w ddddddd (p part, w write, d device)
            0     u1 x 16       channels
        """),
        5: Frame("""
            palm or back, row by row, id ppppp 00000101 00000001 w ddddddd (p part, w write, d device)
            0     u1 x 25       channels
            25    00 x 7        unused
        """),
    }

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """Normal force of each taxel, raw 0..255, shape ``(n_taxels,)``."""
        self.counts = quantize(self.layout.push(reading["force"]), COUNTS_PER_NEWTON, 0, 0xFF)
        return self.counts


class AgibotOmniHandPro(AgibotOmniHand):
    """O12: nine channels a finger, and the force that its firmware makes of them."""

    name = "agibot_omnihand_pro"
    title = "AgiBot OmniHand Pro 2025 (O12)"
    columns = (
        Column(name="channel", low=0, high=0xFFFF, push=1),
        Column(name="normal", unit="N", counts_per_unit=10.0, low=0, high=3000, push=1),
        Column(name="tangential", unit="N", counts_per_unit=10.0, low=0, high=3000),
        Column(name="angle", low=0, high=359),
    )
    sources = ("AgibotTech/OmniHand-Pro-2025@3c7048e src/proto.h, src/c_agibot_hand.cc l.430, l.1234",)
    judge = "cantools, with a DBC of its frames; own second reader"
    assumed = (
        *AgibotOmniHand.assumed,
        "forces are those on all channels of the finger, tangential in 0.1 N as normal; online 1, proximity 0",
    )
    parts = dict.fromkeys(FINGERS, 3)
    answers = {
        3: Frame("""
            finger, row by row, id ppppp 00000101 00000001 w ddddddd (p part, w write, d device)
            0     u1            online
            1     <u2 x 9       channels
            19    <u2           normal        0..3000 [0.1 N]
            21    <u2           tangential
            23    <u2           angle         of the tangential force [deg], 0 towards the tip, clockwise
            25    u1 x 4        proximity
            29    00 x 3        unused
        """)
    }

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """Raw normal force of each taxel; normal and tangential [0.1 N] and its angle [deg] of its finger, each row."""
        force = self.layout.to_taxel_frame(reading["force"])
        x, y, z = force.reshape(len(FINGERS), -1, 3).sum(axis=1).T
        forces = quantize(np.stack([-z, np.hypot(x, y)]), 10.0, 0, 3000)
        angle = np.rint(np.degrees(np.arctan2(x, y))).astype(int) % 360
        of_finger = np.stack([*forces, angle], axis=1).repeat(len(force) // len(FINGERS), axis=0)
        self.counts = np.column_stack([quantize(-force[:, 2], PRO_COUNTS_PER_NEWTON), of_finger])
        return self.counts

    def _answer(self, table: Frame, counts: np.ndarray) -> bytes:
        _, normal, tangential, angle = counts[0].tolist()
        return table.pack(
            online=1, channels=counts[:, 0], normal=normal, tangential=tangential, angle=angle, proximity=[0] * 4
        )
