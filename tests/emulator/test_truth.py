"""What the loop tells of a run: numbered samples, a log in either format, faults where they befell."""

import time

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.clock import VirtualClock
from tactemu.base.errors import TactemuError
from tactemu.control.state import statistics_of
from tactemu.emulator.assembly import assemble, truth_of
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene.file import parse

SKIN = """
[[skin]]
name = "{name}"
device = "anyskin"
link = "pad"
port = "memory:{name}"
faults = {faults}
"""
TWO = '[[body]]\nname = "pad"\nshape = "frame"\nfixed = true\n' + "".join(
    SKIN.format(name=name, faults=faults) for name, faults in (("left", '["drop every 2"]'), ("right", "[]"))
)

BOARD = """
[[skin]]
name = "{name}"
device = "xela_uskin"
device_options = {{ board = {board} }}
link = "pad"
port = "can:virtual:shared"
"""


def run(path=None):
    scene = parse(TWO)
    emulator = assemble(scene, AssemblyOptions(), truth=truth_of(scene, path)).emulator
    emulator.clock = VirtualClock()
    with emulator:
        emulator.run(0.5)
    return emulator


def test_faults_are_counted_under_the_skin_that_they_befell():
    """Two skins, one of which loses every other frame."""
    emulator = run()
    left, right = (statistics_of(emulator, channel) for channel in emulator.channels)
    assert left["injected"] == {"drop": left["samples"] // 2} and right["injected"] == {}
    assert emulator.truth.injected == left["injected"], "the truth's own counter is of the whole run"


@pytest.mark.parametrize("suffix", [".mcap", ".jsonl"])
def test_the_log_of_a_run_has_what_memory_has(tmp_path, suffix):
    truth = run(tmp_path / f"t{suffix}").truth
    log = tt.read_log(tmp_path / f"t{suffix}")
    assert log.origin_ns is None and log.lost == 0, "time was virtual"
    for name in ("left", "right"):
        kept = [sample for sample in truth.samples if sample.device == name]
        skin = log[name]
        assert skin.sample.tolist() == list(range(len(kept))) == [sample.number for sample in kept]
        assert np.array_equal(skin.measured, [sample.measured for sample in kept])
        sent = [frame for _, device, frame in truth.frames if device == name]
        assert [each.frame for each in skin.frames if each.kind == "tx"] == sent


def test_a_log_in_real_time_says_where_on_the_machines_clock_it_is(tmp_path):
    begun = time.monotonic_ns()
    with tt.serve("anyskin", truth=tmp_path / "t.mcap", rate_hz=200) as dev:
        dev.wait(0.1)
    log = tt.read_log(tmp_path / "t.mcap")
    assert log.origin_ns is not None
    assert (
        begun < log.origin_ns + log["anyskin"].t_ns[0] < log.origin_ns + log["anyskin"].t_ns[-1] < time.monotonic_ns()
    )
    assert log["anyskin"].t_ns.tolist() == [sample.t_ns for sample in dev.truth.samples]


def test_keep_bounds_what_a_served_device_remembers():
    with tt.serve("anyskin", "memory:", rate_hz=1000, keep="20kB", clock="lockstep") as dev:
        dev.step(seconds=0.2)
    assert 0 < len(dev.truth.samples) < 20 < dev.truth.forgotten
    assert dev.sample() is not None


def test_frames_say_which_sample_they_carry(tmp_path):
    run(tmp_path / "t.mcap")
    skin = tt.read_log(tmp_path / "t.mcap")["right"]
    counts = dict(zip(skin.sample.tolist(), skin.counts))
    sent = {each.sample: each.frame for each in skin.frames if each.kind == "tx"}
    assert len(sent) > 40 and max(sent) == max(counts)
    assert all(frame == counts[number].astype("<f4").tobytes() + b"\r\n" for number, frame in sent.items())


def test_an_unknown_name_is_an_error_and_none_means_not_yet():
    emulator = assemble(parse(TWO), AssemblyOptions()).emulator
    truth = emulator.truth
    asked = (truth.latest, truth.latest_frame, truth.latest_of, truth.injected_at)
    assert [ask("left") for ask in asked] == [None, None, {}, {}] and truth.latest("left", "force") is None
    for ask in asked:
        with pytest.raises(TactemuError, match=r"^no skin 'lift'; did you mean 'left'\? \(skins: left, right\)$"):
            ask("lift")
    emulator.clock = VirtualClock()
    with emulator:
        emulator.run(0.1)
    assert truth.latest("left", "force") is truth.latest("left") is not None
    with pytest.raises(TactemuError, match=r"^skin 'left': no sense 'forces'; did you mean 'force'"):
        truth.latest("left", "forces")


def test_faults_of_a_shared_bus_are_counted_by_its_name_and_by_each_skin():
    shared = [BOARD.format(name=name, board=k) for k, name in ((1, "left"), (2, "right"))]
    emulator = assemble(parse(TWO.partition("[[skin]]")[0] + "".join(shared)), AssemblyOptions()).emulator
    emulator.truth.inject(0, "left+right", "flip")
    assert [emulator.truth.injected_at(name) for name in ("left", "right", "left+right")] == [{"flip": 1}] * 3
