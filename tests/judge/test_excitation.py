"""Tests of the excitation: every channel of a device changes, independently, and over its range."""

import numpy as np
import pytest

from firmware_protocols import Reading, calls, create
from tactemu.emulator.sources import FunctionSkin
from tactemu.judge.excitation import Excitation, ExcitationRange, flattened
from tactemu.scene.placement import SenseReader

N = 200


def measured_counts(name):
    """Return the counts of a device under the excitation, by stream and sense, shape ``(N, n_channels)``."""
    device = create(name)
    excitation = Excitation({name: ExcitationRange(lambda: create(name))})
    excitation.mode = "random"
    skin = FunctionSkin(name, device)
    senses = SenseReader(skin, device)
    rows = []
    for k in range(N):
        t_ns = 10_000_000 * k
        skin.put(excitation(1e-9 * t_ns)[name], 1e-9 * t_ns)
        row = []
        for stream in device.periods:
            _, seen = senses.read(device.senses_of(stream), t_ns)
            row += flattened(calls.measure(device, Reading(seen, stream), t_ns))
        rows.append(np.concatenate([np.asarray(each, float).ravel() for each in row]))
    return np.array(rows)


@pytest.mark.parametrize("name", ["dynpick", "robotiq_ft300", "bota_sensone", "ati_net_ft", "onrobot_hex"])
def test_the_six_components_of_a_wrench_move_each_by_itself(name):
    counts = measured_counts(name)[:, :6]
    assert (np.ptp(counts, axis=0) > 0).all()
    alike = np.corrcoef(counts.T) - np.eye(6)
    assert np.abs(alike).max() < 0.3


@pytest.mark.parametrize(
    "name", ["weiss_wts", "agibot_omnihand_pro", "brainco_revo2", "dexrobot_dexhand", "digity_exohand", "icub_skin"]
)
def test_every_channel_moves_and_is_not_full_most_of_the_time(name):
    counts = measured_counts(name)
    for ends in (counts.min(axis=0), counts.max(axis=0)):
        assert ((counts == ends).mean(axis=0) < 0.5).all()


def test_a_channel_whose_columns_name_no_sense_is_driven_over_all_that_it_shows():
    counts = measured_counts("weiss_wts")
    assert counts[:, :84].max() > 0.8 * 4095
    counts = measured_counts("icub_skin")
    assert counts.min() < 50, "bytes do not run over where two are compared"


def test_the_sum_over_a_skin_is_not_always_full():
    counts = measured_counts("paxini_px6ax")
    sums = counts.reshape(N, 31, 3)[..., 2].sum(axis=1)
    assert N / 20 < (sums < 255).sum() < N / 4
