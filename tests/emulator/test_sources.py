"""A simulator of the user's own behind a device: what goes in is what is sampled, and what fails says so."""

import threading
import time

import numpy as np
import pytest

import tactemu as tt
from firmware_protocols import create
from tactemu.base.clock import VirtualClock
from tactemu.base.errors import SceneError, SourceError
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.engines.engine import MujocoEngine
from tactemu.scene.file import load, parse
from tactemu.session.serving import serve
from tests.scenes import ball, pad

N = 5  # chips of an AnySkin


def samples_of(source, seconds=0.2, device="anyskin", **options):
    with serve(device, "memory:", source=source, seed=1, **options) as dev:
        dev.wait(seconds)
        samples = list(dev.truth.samples)
    return [sample for sample in samples if sample.t_ns > 0]


def run(path, seconds, source=None):
    """Samples of a run in virtual time."""
    options = AssemblyOptions(port="memory:", rate_hz=100, seed=1, source=source)
    with assemble(load(path), options, clock=VirtualClock()).emulator as emulator:
        emulator.run(seconds)
        return list(emulator.truth.samples)


def ideal(sample):
    """The force of one sample, shape (5, 3)."""
    return np.asarray(sample.ideal)


def ramp(t_s):
    """Taxel k is pushed with k + t newtons, and drawn along x with a tenth of that."""
    push = np.arange(N) + t_s
    return np.stack([push / 10, np.zeros(N), -push], -1)


def test_readings_of_a_function_are_sampled_as_they_are():
    samples = samples_of(ramp, rate_hz=100)
    assert len(samples) > 5
    for sample in samples:
        np.testing.assert_allclose(ideal(sample), ramp(sample.t_ns * 1e-9), atol=1e-12)
        np.testing.assert_array_equal(sample.measured, sample.ideal)


def test_a_wrench_counts_and_not_the_forces():
    wrench = np.array([1.0, -2.0, 3.0, 0.1, -0.2, 0.3])
    samples = samples_of(lambda t_s: {"force": np.ones((1, 3)), "wrench": wrench}, device="dynpick")
    assert {tuple(np.asarray(s.ideal)[0]) for s in samples if s.sense == "wrench"} == {tuple(wrench)}
    with pytest.raises(SourceError, match=r"wrench: expected shape \(6,\)"):
        samples_of(lambda t_s: {"force": np.ones((1, 3)), "wrench": wrench[:3]}, device="dynpick")
    with pytest.raises(SourceError, match=r"wrench: expected shape \(1, 6\), got \(2, 6\)"):
        samples_of(lambda t_s: {"force": np.ones((1, 3)), "wrench": [wrench, wrench]}, device="dynpick")
    with pytest.raises(SourceError, match="got a table of 'force', 'wrench'"):
        samples_of(lambda t_s: {"force": ramp(t_s), "wrench": wrench})


def test_each_of_several_force_torque_sensors_has_its_wrench():
    wrenches = np.arange(30.0).reshape(5, 6) / 10
    samples = samples_of(lambda t_s: {"force": np.zeros((5, 3)), "wrench": wrenches}, device="tesollo_dg")
    assert all(np.array_equal(ideal(sample), wrenches) for sample in samples)


def test_a_function_is_called_for_each_time_once_in_one_thread_and_time_rises():
    calls = []

    def source(t_s):
        calls.append((t_s, threading.current_thread().name))
        return ramp(t_s)

    samples_of(source, rate_hz=100)
    times = [t_s for t_s, _ in calls]
    assert times[0] == 0 and np.all(np.diff(times) > 0)
    names = [name for _, name in calls]
    assert names == sorted(names) and set(names) == {"MainThread", "tactemu"}, "one after the other"


def test_a_table_may_tell_what_is_around_the_device():
    def source(t_s):
        return {"force": ramp(t_s), "temperature": 40.0}

    samples = samples_of(source)
    for sample in samples:
        np.testing.assert_allclose(ideal(sample), ramp(sample.t_ns * 1e-9))


def falling(t_s):
    """A ball that comes down on the middle of the pad at 10 mm/s, from 1 mm above."""
    return {"ball": ((0.0, 0.0, HEIGHT - 0.01 * t_s), (1.0, 0.0, 0.0, 0.0))}


HEIGHT = 0.012 + 1e-3 + 2e-3
SCENE = (
    pad(0.04, 0.04, 0.002)
    + ball(0.012, [0.0, 0.0, 0.1])
    + """
[[skin]]
device = "anyskin"
link = "pad"
position = [0.0, 0.0, 0.001]
embed = 1e-3
options = { radius = 2e-3, normal_stiffness = 500.0, normal_damping = 20.0 }
"""
)


def forces(samples):
    return np.array([-ideal(sample)[:, 2].sum() for sample in samples])


def test_poses_of_a_function_move_a_scene_as_a_motion_does(tmp_path):
    """Velocities are how poses differ: damping feels them as it feels those that a motion tells."""
    path = tmp_path / "pad.toml"
    path.write_text(SCENE)

    def told(t_s):
        position, quaternion = falling(t_s)["ball"]
        return {"ball": tt.Pose(np.array(position), np.array(quaternion), np.array([0, 0, -0.01]), np.zeros(3))}

    felt = [np.array([ideal(sample) for sample in run(path, 0.5, source)]) for source in (falling, told)]
    assert -felt[0][-1, :, 2].sum() > 0.5
    np.testing.assert_allclose(felt[0], felt[1], atol=1e-4)


def scene_with_a_skin(motion=None, **options):
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.04, 0.04, 0.002)), fixed=True, name="pad")
    ball = scene.add_body(tt.Sphere(radius=0.012), name="ball", position=(0, 0, HEIGHT), motion=motion)
    model = tt.KinematicTaxel(
        positions=create("anyskin").layout.positions + np.array([0, 0, 1.5e-3]),
        radius=2e-3, normal_stiffness=500.0,
        **options,
    )  # fmt: skip
    return scene, ball, scene.add_sensor(model, link=pad)


def test_a_scene_that_is_not_built_moves_by_its_own_motions():
    scene, *_ = scene_with_a_skin(tt.FromFunction(function=lambda t_s: (0.0, 0.0, -0.01 * t_s)))
    felt = forces(samples_of(scene, 0.5))
    assert felt[-1] > felt[0] + 0.3


def test_a_built_scene_is_posed_from_any_thread():
    scene, ball, skin = scene_with_a_skin()
    sim = scene.build()
    with serve("anyskin", "memory:", source=sim) as dev:
        assert dev.simulation is sim
        dev.set_pose(ball, position=(0, 0, HEIGHT - 4e-3))
        dev.wait(0.1)
        felt = ideal(dev.sample())
        with pytest.raises(SceneError, match="fixed"):
            dev.set_pose("pad", position=(0, 0, 0))
    assert -felt[:, 2].sum() > 0.3
    np.testing.assert_allclose(skin.read()[0], felt, atol=1e-6)


class Odd:
    """A source that is right until a time, and then gives something else, or raises it."""

    def __init__(self, then, first=ramp, at=0.05):
        self.then, self.first, self.at = then, first, at

    def __call__(self, t_s):
        if t_s < self.at:
            return self.first(t_s)
        if isinstance(self.then, Exception):
            raise self.then
        return self.then


WRONG_LATER = {
    "raises": (Odd(ZeroDivisionError("by zero")), r"source at 0\.0\d+ s raised ZeroDivisionError: by zero"),
    "not finite": (Odd(np.full((N, 3), np.nan)), r"force\[0, 0\]: nan is not finite"),
    "another shape": (Odd(np.zeros((4, 3))), r"force: expected shape \(5, 3\), got \(4, 3\)"),
    "nothing": (Odd(None), "force: expected .*shape"),
    "poses not finite": (Odd({"ball": ((0, 0, np.inf), (1, 0, 0, 0))}, falling), "body 'ball': expected .* all finite"),
    "quaternion of nothing": (Odd({"ball": ((0, 0, 0), (0, 0, 0, 0))}, falling), "body 'ball': expected"),
    "another body": (Odd({"bal": ((0, 0, 0), (1, 0, 0, 0))}, falling), "expected poses of ball, got a table of 'bal'"),
}


@pytest.mark.parametrize("case", WRONG_LATER)
def test_what_fails_later_ends_the_run_and_is_raised_from_stop(case, tmp_path):
    source, said = WRONG_LATER[case]
    (tmp_path / "pad.toml").write_text(SCENE)
    dev = serve(tmp_path / "pad.toml", "memory:", source=source).start()
    deadline = time.monotonic() + 10
    while dev._thread.is_alive() and time.monotonic() < deadline:
        time.sleep(0.01)
    with pytest.raises(SourceError, match=said):
        dev.stop()


def of_another_sign():
    return scene_with_a_skin(convention="genesis")[0]


def late():
    sim = scene_with_a_skin()[0].build()
    sim.step()
    return sim


WRONG_AT_ONCE = {
    "raises": (lambda t_s: 1 / 0, SourceError, "source at 0 s raised ZeroDivisionError"),
    "no source": (7, SceneError, "expected a tactemu.Scene, built or not, or a function"),
    "text": (lambda t_s: "no", SourceError, "force: expected numbers of shape"),
    "another quantity": (lambda t_s: {"pressure": np.zeros(N)}, SourceError, "expected force, temperature"),
    "an empty scene": (tt.Scene(), SceneError, "no sensor 'anyskin'"),
    "of another sign": (
        of_another_sign,
        SceneError,
        "sensor 'KinematicTaxel0': devices measure what acts on the skin; leave out convention=",
    ),
    "not at its start": (late, SceneError, r"is at 0\.001 s; give it at its start: reset\(\)"),
}


@pytest.mark.parametrize("case", WRONG_AT_ONCE)
def test_what_is_wrong_from_the_start_is_told_before_a_port_opens(case, tmp_path):
    source, error, said = WRONG_AT_ONCE[case]
    made = source() if source in (of_another_sign, late) else source
    with pytest.raises(error, match=said):
        serve("anyskin", f"pty:{tmp_path / 'tty'}", source=made).start()
    assert list(tmp_path.iterdir()) == []


def test_a_function_that_is_late_costs_samples_which_are_counted():
    def slow(t_s):
        time.sleep(0.03)
        return ramp(t_s)

    with serve("anyskin", "memory:", source=slow, rate_hz=100) as dev:
        dev.wait(0.5)
        statistics = dev.emulator.channels[0].statistics
        samples = [sample for sample in dev.truth.samples if sample.t_ns > 0]
        assert statistics.missed > 10
    for sample in samples:
        np.testing.assert_allclose(ideal(sample), ramp(sample.t_ns * 1e-9))


MODEL = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="pad"><geom name="plate" type="box" size="0.02 0.02 0.001"/></body>
    <body name="ball" pos="0 0 0.02"><freejoint/><geom name="ball" type="sphere" size="0.012" mass="0.1"/></body>
  </worldbody>
</mujoco>
"""
ENGINE = """
[engine]
kind = "mujoco"
file = "ball.xml"
[[skin]]
device = "anyskin"
link = "{link}"
position = [0.0, 0.0, 0.001]
embed = 5e-4
options = {{ radius = 2e-3, normal_stiffness = 500.0 }}
"""


@pytest.mark.parametrize("link", ["plate", "pad"])
def test_mujoco_moves_the_bodies_of_a_scene_file(link, tmp_path):
    """A ball falls on a pad under gravity: it is felt from the moment at which MuJoCo has it there, and not before."""
    pytest.importorskip("mujoco", reason="pip install 'tactemu[mujoco]'")
    (tmp_path / "ball.xml").write_text(MODEL)
    (tmp_path / "scene.toml").write_text(ENGINE.format(link=link))
    samples = run(tmp_path / "scene.toml", 0.6)
    lands = np.sqrt(2 * 0.007 / 9.81)
    felt = forces(samples)
    times = np.array([sample.t_ns for sample in samples]) * 1e-9
    assert np.all(felt[times < lands - 0.012] == 0)
    assert np.all(felt[-5:] > 0.1)


def test_a_model_that_does_not_keep_up_runs_slower_and_says_so(tmp_path, caplog):
    pytest.importorskip("mujoco", reason="pip install 'tactemu[mujoco]'")
    (tmp_path / "ball.xml").write_text(MODEL)
    scene = tt.Scene(dt=1e-3)
    engine = MujocoEngine(scene, tmp_path / "ball.xml")
    sim = scene.build()
    for t_s, reached in ((0.01, 0.01), (5.0, 0.11), (5.01, 0.12), (9.0, 0.22), (0.0, 0.0), (0.02, 0.02)):
        engine.pose(sim, t_s)
        assert engine.data.time == pytest.approx(reached)
    assert [record.getMessage() for record in caplog.records] == [
        "engine: MuJoCo does not keep up with the clock; it lags behind from 5.000 s on"
    ]


def test_what_mujoco_does_not_have_is_told(tmp_path):
    pytest.importorskip("mujoco", reason="pip install 'tactemu[mujoco]'")
    (tmp_path / "scene.toml").write_text(ENGINE.format(link="palm"))
    with pytest.raises(SceneError, match=r"engine: .*ball\.xml"):
        serve(tmp_path / "scene.toml", "memory:").start()
    (tmp_path / "ball.xml").write_text(MODEL)
    with pytest.raises(SceneError, match="no geom or body 'palm'; geoms: plate, ball; bodies: world, pad, ball"):
        serve(tmp_path / "scene.toml", "memory:").start()
    with pytest.raises(SceneError, match=r"engine: unknown engine 'bullet' \(engines: mujoco, "):
        parse(ENGINE.replace("mujoco", "bullet").format(link="pad"))
