"""What every registered device owes: one test over the registry. A new device is tested by its registration alone."""

import json
import time
from pathlib import Path

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.check import check
from firmware_protocols.check.readings import reading_of
from firmware_protocols.frames import frame_of
from tactemu.base.clock import VirtualClock
from tactemu.emulator.emulator import Channel, Emulator
from tactemu.emulator.sampling import SampleClock
from tactemu.scene.file import default_scene
from tactemu.wire.wire import ReceivedData
from tests.emulator.test_loop import ListWire
from tests.fuzz import TIMES

FUZZ = 2_000 * TIMES
FEW = FUZZ // 4
"""Corrupted requests for a device that has not changed, and for one with other options."""
UNPINNED = json.loads((Path(__file__).parents[1] / "data" / "unpinned.json").read_text())
"""Declared facts that no worked example pins, by device: a number that may only fall."""
VARIANTS = [
    ("ability_hand", {"stuffing": False}),
    ("agibot_omnihand_pro", {"device": 127}),
    ("allegro_v5_sense", {"invalid": (0, 15)}),
    ("ati_net_ft", {"tool": (0.01, -0.02, 0.1), "counts_per_torque": 2_000_000}),
    ("ati_netcanoem", {"base": 0x10, "order": "012345"}),
    ("brainco_revo2", {"touch": "pressure"}),
    ("brainco_revo2", {"touch": "force3d"}),
    ("brainco_revo2_canfd", {"side": "right", "touch": "pressure"}),
    ("brainco_revo3", {"touch": "matrix", "packing": "single"}),
    ("brainco_revo3", {"touch": "matrix"}),
    ("contactile_papillarray", {"sensors": 1, "end_offset": True}),
    ("dexrobot_dexhand", {"side": "right"}),
    ("dfrobot_tactile", {"model": "6x6"}),
    ("digity_exohand", {"side": "left", "records": ("touch",)}),
    ("eflesh_binary", {"missing": (2, 5)}),
    ("feetech_sts3215", {"ids": (7, 1), "encoders": (100.0, 4000.0), "swing": 0.3}),
    ("flexitac", {"rows": 4, "cols": 2}),
    ("flexitac", {"rows": 16}),
    ("fulai_glove", {"hardware": "3.2", "hand": "right", "identity": False}),
    ("ghand5", {"side": "right"}),
    ("icub_skin", {"part": "triangle", "first_board": 3}),
    ("icub_skin", {"triangles_per_board": 16}),
    ("icub_skin", {"part": "hand"}),
    ("icub_skin", {"part": "torso", "firmware": "old"}),
    ("inspire_rh56dftp", {"unit": 2, "first_byte": "high"}),
    ("inspire_rh56dftp", {"line": "native"}),
    ("linker_hand_g20", {"touch": "10x4", "side": "right"}),
    ("linker_hand_g20", {"palm": True}),
    ("linker_hand_g20", {"touch": "23x9", "shown": "set"}),
    ("linker_hand_l10", {"touch": "quantities"}),
    ("linker_hand_l10_rs485", {"side": "right"}),
    ("linker_hand_l20", {"hardware": "V10"}),
    ("linker_hand_l25", {"touch": "quantities", "version_numbers": 4}),
    ("linker_hand_l6", {"touch": "quantities", "side": "right"}),
    ("linker_hand_o6", {"side": "right", "palm": True}),
    ("nibotics_prvs01", {"channels": 19}),
    ("optoforce", {"axes": "4x3"}),
    ("optoforce", {"axes": "6", "counter": "samples"}),
    ("paxini_gen2", {"models": "S1610"}),
    ("paxini_high_speed", {"models": ("M2020", "S1610"), "places": (3, 27)}),
    ("paxini_px6ax", {"models": ("S1813E", "M2020")}),
    ("robotiq_ft300", {"streams": False}),
    ("robotiq_tsf85", {"packets": "per_finger", "magnetometer": True}),
    ("robotis_hx5", {"id": 140}),
    ("rohand", {"touch": "three_axis"}),
    ("rohand", {"touch": "finger", "unit": 3}),
    ("seed_fts3", {"sensors": ("none", "z", "none", "xyz", "xyz")}),
    ("singletact", {"board": "arduino"}),
    ("singletact", {"board": "none", "address": 9}),
    ("sun_fingertip", {"baud": 500_000}),
    ("synria_60", {"unit": 5}),
    ("unitree_dex3", {"side": "right", "cells": (0, 1, 5), "odd_cells": (11,)}),
    ("weiss_dsacon32m", {"mute_s": 8.0}),
    ("weiss_wts", {"values": "sixteenths"}),
    ("wiresens", {"rows": 3, "cols": 5, "values": 8, "sensor": -2}),
    ("xela_server", {"models": ("uSPa22", "uSPa11"), "calibrated": True}),
    ("xela_uskin", {"ids": "grid", "board": 3}),
    ("xela_uskin_4x6", {"first_id": 0x740, "board": 3}),
]


@pytest.mark.parametrize("name", fp.names())
def test_no_fault_in_its_answers(name):
    report = check(name, fuzz=FEW, quick=True)
    assert report.ok, "\n".join(report.lines())


@pytest.mark.each_device
@pytest.mark.parametrize("name", fp.names())
def test_no_fault_and_no_more_facts_unpinned_than_before(name):
    report = check(name, fuzz=FUZZ)
    assert report.ok, "\n".join(report.lines())
    assert len(report.unpinned) == UNPINNED[name], "\n".join(
        [f"{len(report.unpinned)} instead of {UNPINNED[name]}: fewer? lower tests/data/unpinned.json", *report.unpinned]
    )


def test_all_devices_are_made_in_a_moment():
    """Each is made again at every restart, and all of them for the README's table."""
    fp.create(fp.names()[0])
    for name in fp.names():
        fp.device_class(name)
        begun = time.process_time()
        fp.create(name)
        assert time.process_time() - begun < 0.1, name


@pytest.mark.each_device
@pytest.mark.parametrize(("name", "options"), VARIANTS, ids=str)
def test_no_fault_with_other_options(name, options):
    report = check(name, options, fuzz=FEW)
    assert report.ok, "\n".join(report.lines())


@pytest.mark.parametrize("name", fp.names())
def test_its_name_alone_makes_a_scene(name):
    scene = default_scene(name).tables
    assert [skin.device for skin in scene.skin] == [name]
    touched = len(fp.create(name).layout) > 0
    assert len(scene.body) >= 1 + touched, "a link, and something that touches its taxels"


class Still:
    """A skin that nobody touches."""

    imperfections = None

    def __init__(self, device):
        self.device = device

    def read(self, senses, t_ns):
        stream = next(name for name in self.device.periods if senses == self.device.senses_of(name))
        values = reading_of(self.device, 0.0, stream).values
        return values, values


@pytest.mark.parametrize("name", fp.names())
def test_a_wish_for_a_rate_survives_commands_and_restarts(name):
    """The firmware changes its own period, and restarts; the user's holds all the time."""
    device = fp.create(name)
    wires = {port.name: ListWire() for port in device.ports}
    wish_ns = 4_000_000
    channel = Channel(
        "a", device, Still(device), wires, SampleClock(period_ns=wish_ns), dict.fromkeys(device.periods, wish_ns)
    )
    converted = dict.fromkeys(device.periods, ())
    feel = channel.measure

    def watched(stream, measured, t_ns):
        converted[stream] += (t_ns,)
        return feel(stream, measured, t_ns)

    channel.measure = watched
    emulator = Emulator(None, [channel], clock=VirtualClock())
    with emulator:
        emulator.run(0.1 + device.boot_s)
        for command in device.commands:
            wires[command.port or device.ports[0].name].events += [
                ReceivedData(frame_of(each)) for each in command.after
            ]
            wires[command.port or device.ports[0].name].events.append(ReceivedData(command.frame))
            emulator.run(0.02)
        emulator.reset()
        restarted = emulator.clock.now_ns() + round(1e9 * device.boot_s)
        emulator.run(0.1 + device.boot_s)
    new = fp.create(name)
    new.flash.update(device.flash)
    new.power_cycle()
    for stream, times in converted.items():
        after = [t for t in times if t >= restarted]
        assert len(after) >= 20 and set(np.diff(after)) == {wish_ns}, stream
        assert device.periods[stream] == new.periods[stream], "the firmware believes what its flash says"
