"""A skin that plays a truth log sends the bytes of the run that wrote it."""

import pytest

from tactemu.base.clock import VirtualClock
from tactemu.base.errors import SceneError, TactemuError
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene.file import load, parse
from tactemu.truth import Truth


def run(loaded, truth: Truth, seconds: float = 3.0, **run_options) -> list[bytes]:
    """The frames that left in a virtual second."""
    emulator = assemble(loaded, AssemblyOptions(port="memory:", **run_options), truth=truth).emulator
    emulator.clock = VirtualClock()
    with emulator:
        emulator.run(seconds)
    return [frame for _, _, frame in truth.frames]


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "truth.jsonl"
    return path, run(load("anyskin"), Truth(path))


def test_the_same_bytes_without_any_physics(log):
    path, sent = log
    loaded = parse(f'[[skin]]\ndevice = "anyskin"\nreadings = "{path}"\n')
    emulator = assemble(loaded).emulator
    assert emulator.simulation.dt_ns == 0
    assert run(loaded, Truth()) == sent
    assert len(set(sent)) > 10, "it moves"


def test_beside_a_simulated_skin(log):
    path, sent = log
    text = (
        '[[body]]\nname = "pad"\nshape = "frame"\nfixed = true\n'
        '[[body]]\nname = "ball"\nshape = "sphere"\nradius = 0.02\nposition = [0, 0, 0.019]\n'
        f'[[skin]]\nname = "played"\ndevice = "anyskin"\nreadings = "{path}"\n'
        '[[skin]]\nname = "felt"\ndevice = "anyskin"\nlink = "pad"\n'
    )
    truth = Truth()
    run(parse(text), truth)
    assert [frame for _, name, frame in truth.frames if name == "played"] == sent
    felt = [sample.measured for sample in truth.samples if sample.device == "felt"]
    assert felt[-1][0][2] == pytest.approx(-1.0, abs=1e-4)


def test_mistakes(log, tmp_path):
    path, _ = log
    with pytest.raises(SceneError, match="one of the two"):
        parse('[[skin]]\ndevice = "anyskin"\n')
    with pytest.raises(SceneError, match=r"shape \(5, 3\); linker_hand_l6 senses force, shape \(360, 3\)"):
        assemble(parse(f'[[skin]]\ndevice = "linker_hand_l6"\nreadings = "{path}"\n'), AssemblyOptions(port="memory:"))
    with pytest.raises(TactemuError, match=r"no skin 'anyskn'; did you mean 'anyskin'\? "):
        assemble(parse(f'[[skin]]\ndevice = "anyskin"\nreadings = "{path}"\nreadings_of = "anyskn"\n'))
    with pytest.raises(TactemuError, match="cannot read it"):
        assemble(parse('[[skin]]\ndevice = "anyskin"\nreadings = "none.jsonl"\n', folder=tmp_path))
