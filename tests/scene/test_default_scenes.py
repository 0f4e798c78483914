"""Every device's name alone runs: its default scene builds, rests at first, and then presses its taxels."""

import numpy as np
import pytest

import firmware_protocols
from firmware_protocols.senses import CONTACT
from tactemu.base.clock import VirtualClock
from tactemu.base.errors import SceneError
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene.default import IDLE_S, tables_for
from tactemu.scene.file import DEFAULTS, check, device_class, load

TOUCH = (*CONTACT, "wrench", "vibration")


def felt(loaded) -> tuple[np.ndarray, np.ndarray]:
    """Time since boot [s] and largest reading of touch of each sample, for four seconds."""
    rates = dict.fromkeys(device_class(loaded.tables.skin[0].device)().periods, 10.0)
    emulator = assemble(loaded, AssemblyOptions(port="memory:", rate_hz=rates)).emulator
    emulator.clock = VirtualClock()
    boot_s = emulator.channels[0].device.boot_s
    with emulator:
        emulator.run(boot_s + 4)
    senses = {sense.key: sense.quantity in TOUCH for sense in emulator.channels[0].device.sensed} | {"": True}
    touched = [sample for sample in emulator.truth.samples if senses[sample.sense]]
    return np.array([sample.t_ns / 1e9 - boot_s for sample in touched]), np.array(
        [np.abs(s.ideal).max() for s in touched]
    )


@pytest.mark.each_device
@pytest.mark.parametrize("name", firmware_protocols.names())
def test_the_scene_of_every_device_presses_it(name):
    loaded = load(name)
    assert [skin.device for skin in loaded.tables.skin] == [name]
    for body, motion in loaded.motions.items():
        moved = [np.abs(motion.pose(t).position).max() for t in np.arange(0.0, IDLE_S, 0.01)]
        assert max(moved) == 0.0, f"{body} moves before drivers have calibrated"
    if not len(firmware_protocols.create(name).layout):
        return  # motors: nothing to touch
    times, peaks = felt(loaded)
    assert (times < IDLE_S).sum() >= 10, "it samples at rest"
    assert not peaks[times < IDLE_S].any(), "not touched at the start"
    assert peaks.max() > 0.0, "touched later"


@pytest.mark.each_device
@pytest.mark.parametrize(
    "name", ["aidin_aft200", "ati_wireless_ft", "onrobot_rg2_ft", "schunk_fts", "sunrise_m8128", "tesollo_dg"]
)
def test_every_count_of_these_force_torque_sensors_moves(name):
    emulator = assemble(load(name), AssemblyOptions(port="memory:", rate_hz=20)).emulator
    emulator.clock = VirtualClock()
    with emulator:
        emulator.run(5)
    counts = np.array([sample.counts for sample in emulator.truth.samples])
    assert np.ptp(counts, axis=0).all()


def test_every_file_of_a_default_scene_belongs_to_a_device():
    assert {path.stem for path in DEFAULTS.iterdir()} <= set(firmware_protocols.DEVICES)


INHERITED = """
from firmware_protocols.devices.linker_hand import LinkerHandL10

class L10(LinkerHandL10):
    scene = {scene!r}
"""
SCENE = "[[body]]\nname = 'link'\nshape = 'frame'\n[[skin]]\ndevice = '{device}'\nlink = 'link'"


@pytest.mark.parametrize("scene", ["", SCENE.format(device="linker_hand_l10")])
def test_a_class_that_inherits_a_device_runs_itself(tmp_path, scene):
    (tmp_path / "mine.py").write_text(INHERITED.format(scene=scene))
    name = f"{tmp_path}/mine.py:L10"
    assert [skin.device for skin in load(name).tables.skin] == [name]


def test_a_default_scene_of_another_device_is_refused(tmp_path):
    (tmp_path / "mine.py").write_text(INHERITED.format(scene=SCENE.format(device="anyskin")))
    with pytest.raises(SceneError, match="no skin has device = 'linker_hand_l10'"):
        load(f"{tmp_path}/mine.py:L10")


@pytest.mark.parametrize("name", ["anyskin", "linker_hand_o6"])
def test_a_device_without_a_scene_gets_one(name):
    device = device_class(name)
    loaded = check(tables_for(name, device))
    assert len(loaded.tables.body) == 1 + len(device().layout.patches)
    _, peaks = felt(loaded)
    assert peaks[0] == 0.0
    assert peaks.max() > 0.0
