"""Transducers as stages of the plan, against their equations."""

from pathlib import Path

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import SceneError
from tactemu.scene.building import build_scene, make_devices
from tactemu.scene.file import parse
from tactemu.transducers import laws
from tactemu.transducers.capacitive import EPSILON_0, Capacitive
from tactemu.transducers.fluid import Fluid
from tactemu.transducers.magnetic import Magnetic
from tactemu.transducers.material import Material
from tactemu.transducers.piezoresistive import Piezoresistive
from tactemu.transducers.registry import TRANSDUCERS, make_transducer, transducer_class
from tests.scenes import ball, pad
from tests.transducers.dipoles import dipole_field

SPOTS = np.array([[0.0, 0.0, 0.01], [0.007, 0.0, 0.01], [0.0, 0.007, 0.01]])
AREA = np.pi * 1e-6


def skin(*transducers, probes=SPOTS, turned=(1, 0, 0, 0), n_envs=None, dtype="float64", dt=1e-3, **options):
    """``(simulation, ball, sensor)``; the ball is far away."""
    scene = tt.Scene(dt=dt)
    pad = scene.add_body(None, name="pad", fixed=True, quaternion=turned)
    ball = scene.add_body(tt.Sphere(radius=0.02), name="ball", position=(0, 0, 1))
    model = tt.KinematicTaxel(
        positions=probes, radius=1e-3, normal_stiffness=1000.0, normal_damping=0.0, shear_scalar=0.0,
        twist_scalar=0.0, electronics=tt.ElectronicsOptions(**options),
    )  # fmt: skip
    sensor = scene.add_sensor(model, link=pad, name="skin", transducers=transducers)
    return scene.build(n_envs, dtype=dtype), ball, sensor


def pressed(made, force):
    """The reading with this force [N] on the first taxel."""
    sim, ball, sensor = made
    sim.set_pose(ball, position=(0, 0, 0.01 + 0.02 + 1e-3 - force / 1000.0) if force else (0, 0, 1))
    sim.step()
    return sensor.read()


def test_every_transducer_says_what_it_is_and_where_it_holds():
    for name in TRANSDUCERS:
        kind = transducer_class(name)
        assert kind.takes and kind.valid and kind.source and kind.__doc__
        assert make_transducer("skin", {"kind": name}) == kind()


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_the_field_of_a_skin_is_that_of_its_dipoles_where_they_have_moved(dtype):
    rng = np.random.default_rng(2)
    magnets, moments = rng.uniform(-0.004, 0.004, (30, 3)) * [1, 1, 0.1], rng.normal(0, 1e-4, (30, 3))
    magnetic = Magnetic(
        magnets=magnets.tolist(), moments=moments.tolist(), chip_depth=4e-3, compliance=5e-4, spread=2e-3
    )
    made = skin(magnetic, dtype=dtype)
    rest = pressed(made, 0.0)
    places, _ = magnetic.places(SPOTS)
    chips = SPOTS - [0, 0, 4e-3]
    assert rest == pytest.approx(dipole_field(chips, places, moments), rel=2e-5, abs=1e-8)
    field = pressed(made, 0.8)
    taxels, shares = magnetic.shares(places, SPOTS)
    moved = places + (shares * (taxels == 0)).sum(axis=1)[:, None] * 5e-4 * np.array([0, 0, -0.8])
    assert field == pytest.approx(dipole_field(chips, moved, moments), rel=2e-5, abs=1e-8)
    assert np.abs(field - rest)[1].max() > 1e-6, "a chip beside the press sees it, too"


def test_the_earth_turns_with_the_link_and_neighbours_move_with_their_bodies():
    weak = Magnetic(moments=((0, 0, 1e-12),), earth=(2e-5, 0, -4e-5))
    quarter = (np.sqrt(0.5), 0, 0, np.sqrt(0.5))  # about z
    still = pressed(skin(weak), 0.0)
    turned = pressed(skin(weak, turned=quarter), 0.0)
    assert still[0] == pytest.approx([2e-5, 0, -4e-5], abs=1e-8)
    assert turned[0] == pytest.approx([0, -2e-5, -4e-5], abs=1e-8)
    beside = Magnetic(moments=((0, 0, 1e-12),), neighbours=[("ball", (0, 0, 0), (0, 0, 0.01))])
    near = skin(beside)
    near[0].set_pose(near[1], position=(0.05, 0, 0.01))
    near[0].step()
    chips = SPOTS - [0, 0, 2e-3]
    expected = dipole_field(chips, np.array([[0.05, 0, 0.01]]), np.array([[0, 0, 0.01]]))
    assert near[2].read() == pytest.approx(expected, rel=1e-3, abs=1e-9)


def test_a_resistance_falls_with_pressure_and_a_divider_bends():
    law = Piezoresistive(half=2e5, exponent=1.5, fixed=1e4, r_open=1e9)
    made = skin(law)
    assert pressed(made, 0.0) == pytest.approx([1e9, 1e9, 1e9])
    for force in (0.3, 0.9):
        expected = 1e4 * (force / AREA / 2e5) ** -1.5
        assert pressed(made, force)[0] == pytest.approx(expected, rel=1e-6)
    share = Piezoresistive(half=2e5, exponent=1.5, rated_n=10.0, gain=0.5, threshold=0.05)
    made = skin(share)
    expected = laws.divider(0.5 / AREA, 0.5, 2e5, 1.5)
    assert pressed(made, 0.5)[0] == pytest.approx([0, 0, -10 * expected], rel=1e-6)
    assert (pressed(made, 0.05)[0] == 0).all(), "below the threshold"


def test_warmth_changes_gain_and_zero_by_terms_of_their_own():
    cold = Piezoresistive(half=2e5, exponent=2.0, rated_n=1.0, temperature=45.0, zero_per_k=1e-3)
    assert pressed(skin(cold), 0.0)[:, 2] == pytest.approx(-0.02)
    warm = Piezoresistive(half=2e5, exponent=2.0, rated_n=1.0, temperature=45.0, half_per_k=0.05, gain_per_k=-0.01)
    u = (0.5 / AREA / 2e5) ** 2 * np.exp(0.05 * 20)
    assert pressed(skin(warm), 0.5)[0, 2] == pytest.approx(-0.8 * u / (1 + u), rel=1e-6)


def test_ghosts_show_at_the_fourth_corner():
    x = np.array([0.0, 0.004, 0.008])
    probes = np.stack([*np.meshgrid(x, x), np.full((3, 3), 0.01)], axis=-1)
    law = Piezoresistive(half=1e5, exponent=1.0, rated_n=1.0, ghosts=0.2)
    sim, ball, sensor = skin(law, probes=probes)
    plain = skin(Piezoresistive(half=1e5, exponent=1.0, rated_n=1.0), probes=probes)
    for each in ((sim, ball), plain[:2]):
        each[0].set_pose(each[1], position=(0.0, 0.0, 0.0303))
        each[0].step()
    v, felt = -plain[2].read()[..., 2], -sensor.read()[..., 2]
    assert felt == pytest.approx(v + 0.2 * v.sum(1, keepdims=True) * v.sum(0) / v.sum(), rel=1e-6)
    with pytest.raises(SceneError, match="rows and columns"):
        skin(law)


def test_a_gap_closes_and_its_firmware_forgets_a_press_that_lasts():
    made = skin(Capacitive(gap=1e-3, modulus=4e5, permittivity=4.0, stray=2e-12, dead_band=1e4))
    assert pressed(made, 0.0)[0] == pytest.approx(2e-12 + EPSILON_0 * 4 * AREA / 1e-3, rel=1e-6)
    expected = 2e-12 + EPSILON_0 * 4 * AREA / 1e-3 * (1 + (0.7 / AREA - 1e4) / 4e5)
    assert pressed(made, 0.7)[0] == pytest.approx(expected, rel=1e-6)
    made = skin(Capacitive(modulus=4e5, rated_n=1.0, baseline_tau=0.2), dt=0.01)
    first = pressed(made, 0.7)[0, 2]
    for _ in range(19):
        last = pressed(made, 0.7)[0, 2]
    assert last / first == pytest.approx(np.exp(-0.19 / 0.2), rel=1e-3)
    assert pressed(made, 0.0)[0, 2] > 0.5 * abs(first), "and reads a pull when it ends"


def test_a_medium_is_late_and_may_be_shared():
    made = skin(Fluid(tau=0.05))
    for _ in range(50):
        late = pressed(made, 0.6)
    assert late[0] == pytest.approx(0.6 / AREA * -np.expm1(-1.0), rel=1e-6)
    shared = skin(Fluid(tau=1e-6, shared=True))
    assert pressed(shared, 0.6) == pytest.approx(0.6 / AREA / 3, rel=1e-6)


def test_creep_is_a_share_per_decade_of_what_it_was_after_a_second():
    made = skin(Material(creep_per_decade=0.4, reference=0.5, creep_exponent=0.3), dt=0.02)
    after = {}
    for step in range(1, 1001):
        after[step] = -pressed(made, 0.8)[0, 2]
    share = 0.4 * (0.8 / 0.5) ** -0.3
    assert after[50] == pytest.approx(0.8, rel=0.01)
    assert after[500] / after[50] == pytest.approx(1 + share, rel=0.02)
    assert after[1000] / after[50] == pytest.approx(1 + share * np.log10(20.0), rel=0.02)


@pytest.mark.parametrize("peak", [0.3, 0.8])
def test_a_loop_is_as_wide_a_share_of_every_peak(peak):
    made = skin(Material(loop=0.12))
    up = np.linspace(0, peak, 101)
    loading = [-pressed(made, force)[0, 2] for force in up]
    unloading = [-pressed(made, force)[0, 2] for force in up[::-1]][::-1]
    gap = np.array(unloading) - np.array(loading)
    assert loading == pytest.approx(up, abs=1e-6)
    assert gap.max() == pytest.approx(0.12 * peak, rel=0.02)
    assert gap[[0, -1]] == pytest.approx(0, abs=0.02 * peak)


def test_presses_work_a_skin_in_and_leave_something_behind_within_bounds():
    made = skin(Material(softening=0.03, baseline=0.02))
    peaks, rests = [], []
    for _ in range(6):
        pressed(made, 0.4)
        peaks.append(-pressed(made, 0.8)[0, 2])
        rests.append(-pressed(made, 0.0)[0, 2])
    n = np.arange(6)
    assert rests == pytest.approx(0.02 * 0.8 * np.log(2 + n), rel=1e-6)
    left = np.concatenate([[0.0], rests[:-1]])
    assert peaks == pytest.approx(0.8 * (1 - 0.03 * np.log1p(n)) + left, rel=1e-6)


def test_noise_and_resolution_are_those_of_the_last_transducer():
    made = skin(Fluid(tau=1e-6), resolution=100.0, noise=0.0)
    assert pressed(made, 0.6)[0] == pytest.approx(round(0.6 / AREA / 100) * 100)
    sensor = made[2]
    assert sensor.quantities == ("pressure",)
    assert sensor.read_ground_truth()[0] == pytest.approx(0.6 / AREA, rel=1e-6)


def test_environments_are_reset_by_themselves():
    sim, ball, sensor = skin(Fluid(tau=0.1), n_envs=2)
    sim.set_pose(ball, position=(0, 0, 0.0305))
    for _ in range(20):
        sim.step()
    sim.reset([0])
    sim.set_pose(ball, position=(0, 0, 0.0305))
    sim.step()
    first, second = sensor.read()[:, 0]
    assert first == pytest.approx(0.5 / AREA * -np.expm1(-0.01), rel=1e-6) and second > 10 * first


def test_transducers_that_do_not_fit_are_refused_in_words():
    with pytest.raises(SceneError, match="Fluid takes force or pressure, not the field before it"):
        skin(Magnetic(), Fluid())
    with pytest.raises(SceneError, match="did you mean 'magnetic'"):
        make_transducer("skin 'a'", {"kind": "magnetik"})
    with pytest.raises(SceneError, match="piezoresistive has no 'expo'"):
        make_transducer("skin 'a'", {"kind": "piezoresistive", "expo": 2})
    with pytest.raises(SceneError, match="tau must be > 0 s"):
        make_transducer("skin 'a'", {"kind": "fluid", "tau": 0})
    with pytest.raises(SceneError, match="no body 'wall'"):
        skin(Magnetic(neighbours=[("wall", (0, 0, 0), (0, 0, 1))]))


MOTION = 'motion = {{ kind = "press", approach = 0.003, depth = 0.001, speed = 0.05, repeat = 0 }}'
SCENE = (
    pad()
    + ball(0.01, [0.0, 0.0, 0.013], MOTION)
    + """
[[skin]]
device = "{device}"
link = "pad"
port = "memory:"
options = {{ noise = 1e-7 }}
[[skin.transducer]]
kind = "material"
loop = 0.1
[[skin.transducer]]
kind = "{kind}"
"""
)


@pytest.mark.parametrize("device", ["anyskin", "eflesh_binary"])
def test_a_device_of_magnets_sees_the_field_of_the_scene(device):
    from tactemu.base.clock import VirtualClock
    from tactemu.emulator.assembly import assemble

    made = assemble(parse(SCENE.format(device=device, kind="magnetic")), clock=VirtualClock())
    truth = made.emulator.truth
    with made.emulator as emulator:
        emulator.run(2.5 if device == "eflesh_binary" else 0.3)
    assert {stage.name for stage in made.simulation.plan.stages} >= {f"{device}: magnets", f"{device}: field"}
    counts = np.array([each.counts for each in truth.samples])[..., -3:]
    magnetic = Magnetic()
    layout = made.emulator.channels[0].device.layout
    chips = layout.positions - [0, 0, 2e-3]
    rest = layout.to_taxel_frame(dipole_field(chips, *magnetic.places(layout.positions))) * 1e6
    turn = np.array([1, -1, -1]) if device == "anyskin" else 1
    apart = np.abs(counts - rest * turn).max(axis=(1, 2))
    assert apart.min() < 4.0 and apart.max() > 5.0


def test_a_device_that_does_not_see_it_says_so():
    from tactemu.emulator.assembly import assemble

    with pytest.raises(SceneError, match="its transducers provide field, but robotiq_tsf85 senses"):
        assemble(parse(SCENE.format(device="robotiq_tsf85", kind="magnetic")))


def test_the_page_has_a_scene_that_is_built():
    page = (Path(__file__).parents[2] / "docs" / "transducers.md").read_text()
    loaded = parse(page.split("```toml\n")[1].split("```")[0])
    (device,) = make_devices(loaded).values()
    scene, placed = build_scene(loaded, make_devices(loaded))
    assert device.contact == ("field",) and placed["anyskin"].parts[0].sensor.quantities == ("field",)
    stages = [stage.name for stage in scene.build().plan.stages]
    kinds = ["soft skin", "magnets", "field", "electronics"]
    places = [max(k for k, name in enumerate(stages) if name == f"anyskin: {kind}") for kind in kinds]
    assert places == sorted(places)
