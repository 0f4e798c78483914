"""Devices with the numbers of real ones: what they send at rest has the figures that were measured."""

import json

import numpy as np
import pytest

import firmware_protocols
from tactemu.base.clock import VirtualClock
from tactemu.base.errors import SceneError
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.fit.realism import PARAMETERS
from tactemu.scene.file import check, load, parse
from tactemu.scene.measured_defaults import measured_devices

FITTED = json.loads(PARAMETERS.read_text())


def at_rest(name, seconds=10.0, setup=(), **keys):
    """Counts ``(n, ...)`` of a skin that nothing touches, and when its frames left [s]."""
    tables = {
        "scene": {"dt": 5e-3},
        "body": [{"name": "pad", "shape": "frame", "fixed": True}],
        "skin": [{"device": name, "link": "pad", "measured": True, **keys}],
    }
    emulator = assemble(check(tables), AssemblyOptions(port="memory:", seed=1), clock=VirtualClock()).emulator
    with emulator:
        for frame in setup:
            emulator.channels[0].wire.transport.driver.write(frame)  # pyright: ignore
        emulator.run(seconds)
        counts = np.array([sample.counts for sample in emulator.truth.samples], float)
        left = np.array([t_ns for t_ns, _, _ in emulator.truth.frames]) * 1e-9
    return counts[1:], left


def test_magnets_have_the_steps_the_noise_and_the_memory_of_real_ones():
    field = at_rest("anyskin", 20.0)[0][:, :, 1:]
    law = FITTED["anyskin_leap"]["still"]
    assert field.std(axis=0).mean(axis=0) == pytest.approx(law["std_ut"], rel=0.1)
    away = field - field.mean(axis=0)
    after = (away[1:] * away[:-1]).mean(axis=0) / away.var(axis=0)
    assert after.mean() == pytest.approx(law["correlation"], rel=0.2)
    assert np.diff(np.unique(field[:, 0, 2])).min() == pytest.approx(0.484, rel=1e-3)


def test_pads_of_a_hand_have_the_pattern_of_a_real_one_and_repeat_as_often():
    from firmware_protocols.frames import frame_of

    setup = [frame_of(f"201#{data}") for data in ("4D0114F0", "5000040201 0022".replace(" ", ""), "0700")]
    counts = at_rest("icub_skin", 10.0, setup, device_options={"part": "hand"})[0][:, :60]
    law = FITTED["icub_hand_2012"]
    counts = counts[len(counts) // 2 :]
    assert counts.mean() == pytest.approx(np.mean(law["rest"]), abs=0.5)
    assert counts.mean(axis=0).std() == pytest.approx(np.std(law["rest"]), abs=0.5)
    assert np.mean(np.diff(counts, axis=0) == 0) == pytest.approx(law["unchanged"], abs=0.05)


@pytest.mark.parametrize(
    ("name", "period_s", "spread_s", "noise"),
    [
        ("cyskin_cpm_finger", 28.08e-3, 0.29e-3, 1.4),
        ("weiss_dsacon32m", 32e-3, 1.3e-3, None),  # no texel reads below 0
        ("flexitac", 9.7e-3, 1.75e-3, None),
    ],
)
def test_frames_come_when_those_of_real_ones_do(name, period_s, spread_s, noise):
    setup = [bytes.fromhex("AAAAAA030600011D")] if name == "weiss_dsacon32m" else ()
    counts, left = at_rest(name, 10.0, setup)
    begin = left[np.concatenate([[True], np.diff(left) > period_s / 3])]
    if len(begin) > 3:
        assert np.diff(begin).mean() == pytest.approx(period_s, rel=0.01)
        assert np.diff(begin).std() == pytest.approx(spread_s, rel=0.15)
    if noise is not None:
        assert np.diff(counts, axis=0).std() / np.sqrt(2) == pytest.approx(noise, rel=0.1)


def test_a_taxel_of_magnets_is_as_noisy_as_was_published():
    std = at_rest("xela_uskin", 5.0)[0].std(axis=0)
    assert 1.5 < std[:, :2].mean() < 2.5 and 1.8 < std[:, 2].mean() < 3.1


def test_what_a_scene_says_goes_first_and_without_a_wish_nothing_changes():
    text = (
        "[[body]]\nname = 'pad'\nshape = 'frame'\nfixed = true\n"
        "[[skin]]\ndevice = 'flexitac'\nlink = 'pad'\nclock = { delay_s = 0.001 }\n"
    )
    plain, numbered = parse(text).tables.skin[0], parse(text + "measured = true\nrate_hz = 50\n").tables.skin[0]
    assert (plain.rate_hz, plain.clock.jitter_s) == (None, 0.0)
    assert (numbered.rate_hz, numbered.clock.jitter_s, numbered.clock.delay_s) == (50, 4.3e-3, 1e-3)
    with pytest.raises(SceneError, match="there are no measured parameters of 'optoforce'"):
        parse(text.replace("flexitac", "optoforce") + "measured = true\n")
    with pytest.raises(SceneError, match="for the transducers magnetic"):
        parse(text.replace("flexitac", "anyskin") + "measured = true\ntransducer = [{ kind = 'material' }]\n")
    with pytest.raises(SceneError, match="there are no measured parameters of optoforce"):
        assemble(load("optoforce"), AssemblyOptions(port="memory:", measured=True))


@pytest.mark.parametrize("name", measured_devices())
def test_every_default_scene_runs_with_them(name):
    assert name in firmware_protocols.DEVICES
    with assemble(
        load(name), AssemblyOptions(port="memory:", measured=True), clock=VirtualClock()
    ).emulator as emulator:
        emulator.run(0.1)
