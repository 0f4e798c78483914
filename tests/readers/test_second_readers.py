"""Readers of our own for devices that no package on the index reads, each in its own process against the bare device.

Whoever wrote a reader knew the description of the wire and not the device file, so that a mistake would have to be made
twice. What a reader found ambiguous stands in its docstring.
"""

import itertools
import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.check.readings import reading_of
from tests.drivers.can_link import INTERFACE
from tests.drivers.rig import Rig, assert_consecutive

pytestmark = [pytest.mark.driver, pytest.mark.timeout(90)]


class Pulled(Rig):
    """Every sample another force on every taxel, along all axes, and where a wrench is felt another wrench."""

    def reading(self, stream):
        device, normals = self.device, self.device.layout.normals
        pushes = self._random.uniform(0.0, self.peak, len(normals))
        pulls = self._random.uniform(-self.peak / 2, self.peak / 2, normals.shape)
        pulls -= (pulls * normals).sum(1, keepdims=True) * normals
        felt = {"force": pulls - pushes[:, None] * normals, "wrench": self._random.uniform(-9.0, 9.0, 6)}
        keys = {sense.quantity: sense.key for sense in device.senses_of(stream)}
        return reading_of(device, pushes, stream, **{keys[name]: felt[name] for name in felt if name in keys})


@dataclass
class Case:
    device: str
    reader: str
    options: dict = field(default_factory=dict)
    arguments: tuple = ()
    kind: str = "serial"
    peak: float = 3.0
    shown: Callable = lambda device, counts: counts.ravel()
    """What the description has the driver give, of what the device felt; a row for each part that is read by itself."""
    compared: Callable = lambda readings: [readings]
    """Sequences of what was read, each of which goes through the truth by itself."""
    guarded: bool = True
    """A wrong byte shows: there is a checksum."""
    count: int = 200
    """Readings asked for."""

    def on(self, rig):
        """The device on a rig."""
        return rig(fp.create(self.device, **self.options), kind=self.kind, peak=self.peak)

    def __str__(self):
        return "-".join([self.device, *map(str, (*self.options.values(), *self.arguments))])


PADS = [pad for pad in range(12) if pad not in (6, 10)]
"""Of a triangle of the iCub; the two others are thermal."""


def by_finger(readings):
    """Fingers are asked for one after the other, and each feels something else by then."""
    return np.reshape(readings, (len(readings), 5, -1)).swapaxes(0, 1)


def omnihand_pro(device, counts):
    """Online 1 and no proximity are the device's assumptions."""
    return [[1, *finger[:, 0], *finger[0, 1:], 0, 0, 0, 0] for finger in counts.reshape(5, 9, 4)]


def omnihand_o10(values):
    """Sixteen values of each finger, 25 of palm and back."""
    return np.split(values, [16, 32, 48, 64, 80, 105])


def rohand(device, counts):
    """Of each part; the palm has dots always."""
    *fingers, palm = (counts[patch.taxels] for patch in device.layout.patches)
    return [*(finger.ravel() for finger in fingers), palm.reshape(len(palm), -1)[:, 0]]


def dexhand(device, counts):
    """Of each fingertip."""
    return np.column_stack([counts.item()["force"], counts.item()["temperature"]])


CASES = [
    Case(
        "agibot_omnihand_o10",
        "omnihand.py",
        arguments=("o10",),
        kind="can",
        shown=lambda device, counts: omnihand_o10(device.layout.on_wire(counts)),
        compared=lambda readings: list(zip(*map(omnihand_o10, readings))),
        guarded=False,
    ),
    Case(
        "agibot_omnihand_pro",
        "omnihand.py",
        arguments=("pro",),
        kind="can",
        shown=omnihand_pro,
        compared=by_finger,
        guarded=False,
    ),
    Case(
        "allegro_v5_sense",
        "allegro_v5.py",
        {"invalid": (3,)},
        kind="can",
        shown=lambda device, counts: counts << 2,
        guarded=False,
    ),
    Case(
        "barrett_bh8",
        "barrett_bh8.py",
        kind="can",
        shown=lambda device, counts: counts.reshape(4, 24) / 256,
        compared=lambda readings: [[r[1:] for r in readings if r[0] == puck] for puck in range(11, 15)],
        guarded=False,
        count=840,
    ),
    Case("bielefeld_glove", "bielefeld_glove.py", guarded=False),
    Case(
        "brainco_revo2_canfd",
        "revo2_canfd.py",
        kind="can",
        shown=lambda device, counts: np.concatenate([counts[:, :3].ravel(), counts[:, 3], np.zeros(5)]),
    ),
    Case(
        "brainco_revo2_canfd",
        "revo2_canfd.py",
        kind="can",
        shown=lambda device, counts: [*counts[:, :3].ravel(), *counts[:, 3], 0, 0, 0, 0, 0],
    ),
    Case("cyskin_cpm_finger", "cyskin_cpm_finger.py", kind="can", guarded=False),
    Case(
        "dexrobot_dexhand",
        "dexhand021.py",
        {"side": "right"},
        kind="can",
        shown=dexhand,
        compared=lambda readings: [
            [np.take(r, (1, 3, 5, 7)) for r in readings if r[0] == b] for b in (7, 9, 10, 11, 12)
        ],
        guarded=False,
        count=1100,
    ),
    Case("dfrobot_tactile", "dfrobot_tactile.py"),
    Case("dfrobot_tactile", "dfrobot_tactile.py", {"model": "6x6"}, peak=9.0),
    Case(
        "bota_sensone",
        "bota_sensone.py",
        shown=lambda device, counts: [*counts.item()["wrench"][0], *counts.item()["temperature"]],
    ),
    Case("dynpick", "dynpick.py", guarded=False, shown=lambda device, counts: counts.item()["wrench"][0]),
    Case("eflesh_binary", "eflesh_binary.py"),
    Case(
        "contactile_papillarray",
        "contactile_papillarray.py",
        compared=lambda readings: [[reading[: 2 * 9 * 6] for reading in readings]],
    ),
    Case(
        "ghand5",
        "ghand5.py",
        shown=lambda device, counts: [counts[patch.taxels].ravel() for patch in device.layout.patches],
        # The resultants are summed before they are rounded: the taxels are compared.
        compared=lambda readings: list(zip(*(np.split(r[15:], [114, 207, 300, 393]) for r in readings))),
    ),
    Case(
        "icub_skin",
        "icub_skin.py",
        arguments=(1, 0, 2),
        kind="can",
        shown=lambda device, counts: counts[device.boards["board 1"].taxels],
        compared=lambda readings: [[np.reshape(r, (3, 12))[:, PADS].ravel() for r in readings]],
        guarded=False,
    ),
    Case(
        "icub_skin",
        "icub_skin.py",
        {"part": "torso"},
        arguments=(3, 0, 11),
        kind="can",
        shown=lambda device, counts: counts[device.boards["board 3"].taxels],
        compared=lambda readings: [[np.reshape(r, (12, 12))[:, PADS].ravel() for r in readings]],
        guarded=False,
    ),
    Case(
        "icub_skin",
        "icub_skin.py",
        {"part": "hand"},
        arguments=(1, 0, 4),
        kind="can",
        shown=lambda device, counts: counts[:60],
        guarded=False,
    ),
    Case(
        "linker_hand_g20",
        "linkerhand_can.py",
        {"palm": True},
        arguments=("palm", "left"),
        kind="can",
        peak=0.5,
        shown=lambda device, counts: [*counts[-224:], counts[-224:].sum(dtype=int)],
        guarded=False,
    ),
    *(
        Case(
            f"linker_hand_{model}",
            "linkerhand_can.py",
            arguments=(size, "left"),
            kind="can",
            peak=0.5,
            shown=lambda device, counts: counts.reshape(5, -1),
            compared=by_finger,
            guarded=False,
        )
        for model, size in (("l20", "6x12"), ("o6", "10x4"))
    ),
    Case(
        "linker_hand_l10_rs485",
        "linkerhand_l10.py",
        arguments=("left",),
        peak=0.5,
        shown=lambda device, counts: counts.reshape(5, -1),
        compared=by_finger,
    ),
    Case(
        "osmo_glove",
        "osmo_glove.py",
        shown=lambda device, counts: counts,
        compared=lambda readings: [
            [r[4:] for r in readings if r[3] == 4 * finger + 1 + second] for finger in range(5) for second in (0, 20)
        ],
        guarded=False,
        count=2200,
    ),
    Case("paxini_gen2", "paxini_gen2.py", peak=20.0),
    Case(
        "robotera_xhand",
        "robotera_xhand.py",
        # The force of a tip is summed before it is rounded: its points are compared.
        compared=lambda readings: [[np.reshape(reading, (5, 363))[:, 3:].ravel() for reading in readings]],
    ),
    *(
        Case(
            "rohand",
            "rohand.py",
            {"touch": touch},
            peak=5.0,
            shown=rohand,
            compared=lambda readings, ends=ends: list(zip(*(np.split(reading, ends) for reading in readings))),
        )
        for touch, ends in (("dots", [36, 96, 156, 216, 248]), ("three_axis", [3, 9, 15, 21, 24]))
    ),
    Case("seed_fts3", "seed_fts3.py", guarded=False),
    Case("seed_fts3", "seed_fts3.py", arguments=("crlf",), guarded=False),
    Case("singletact", "singletact.py", guarded=False),
    Case("singletact", "singletact.py", options={"board": "arduino"}, guarded=False),
    Case(
        "sun_fingertip",
        "sun_fingertip.py",
        {"baud": 1_000_000},
        shown=lambda device, counts: counts * 3.3 / 4096,
        guarded=False,
    ),
    Case("vitac_3d", "vitac_3d.py", guarded=False),
    Case("weiss_dsacon32m", "weiss_dsacon32m.py", peak=4.0),
    Case("weiss_dsacon32m", "weiss_dsacon32m.py", arguments=("plain",), peak=4.0),
    *(
        Case(
            "weiss_wts",
            "weiss_wts.py",
            {"values": taken},
            (how, taken),
            peak=4.0,
            shown=lambda device, counts: counts.item()["force"],
        )
        for how, taken in (("periodic", "low_first"), ("single", "low_first"), ("single", "sixteenths"))
    ),
    Case("wiresens", "wiresens.py", arguments=(64,), guarded=False),
    Case("wiresens", "wiresens.py", {"rows": 8, "cols": 15, "values": 120}, guarded=False),
    Case("xela_uskin", "xela_uskin.py", kind="can", guarded=False),
    Case("xela_uskin_4x6", "xela_uskin.py", arguments=("4x6",), kind="can", guarded=False),
]


def judged(cases):
    """As parameters, each marked as the judge that it is."""
    for case in cases:
        carrier = {"can": "CAN", "tcp": "TCP"}.get(case.kind, case.kind)
        mark = pytest.mark.judge(case.device, driver="own second reader", carrier=carrier, script=case.reader)
        yield pytest.param(case, id=str(case), marks=mark)


def read(reader, port, *arguments, count=200):
    """Exit status, what was printed, and what was complained of."""
    command = [sys.executable, str(Path(__file__).with_name(reader)), port, str(count), *map(str, arguments)]
    environment = {**os.environ, "CAN_INTERFACE": INTERFACE, "PYTHONPATH": ""}
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60, env=environment)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("case", [*judged(CASES)])
def test_200_consecutive_readings(case):
    with case.on(Pulled) as rig:
        status, printed, complaint = read(case.reader, rig.port, *case.arguments, count=case.count)
    assert status == 0, complaint[-2000:]
    readings, lost = (json.loads(printed)[key] for key in ("readings", "lost"))
    assert lost < len(readings) / 4, "a busy machine loses a few frames, not so many"
    sequences = case.compared(readings)
    for part, sequence in enumerate(sequences):
        assert (np.ptp(np.asarray(sequence, float), axis=0) > 0).mean() > 0.7, "numbers that never change"

        def decode(counts, part=part):
            shown = case.shown(rig.device, counts)
            return shown if len(sequences) == 1 else shown[part]

        places = assert_consecutive(sequence, rig.truth, decode=decode)
        assert len(set(places)) >= 30, "the same samples again and again"


class Noisy(Pulled):
    """Of every 40th frame one bit in the middle is turned over."""

    def __init__(self, *arguments, **named):
        super().__init__(*arguments, **named)
        opened, sent = self._open, itertools.count(1)

        def spoiled():
            port, link = opened()
            write = link.write
            link.write = lambda frame: write(frame if next(sent) % 40 else turned(frame))
            return port, link

        self._open = spoiled


def turned(frame):
    data = bytearray(frame if isinstance(frame, bytes) else frame.data)
    data[len(data) // 2] ^= 1
    return bytes(data) if isinstance(frame, bytes) else replace(frame, data=bytes(data))


@pytest.mark.parametrize("case", [*judged(case for case in CASES if case.guarded)])
def test_a_wrong_bit_is_one_sentence(case):
    with case.on(Noisy) as rig:
        status, printed, complaint = read(case.reader, rig.port, *case.arguments)
    assert status == 1 and not printed
    assert complaint.startswith(f"{case.reader}: ") and complaint.count("\n") == 1
