"""Readings: named fields, the same names on the device, what a skin tells of itself, and contacts by body."""

import numpy as np
import pytest
import warp as wp

import tactemu as tt
from tactemu.models import Compiled, SensorModel
from tactemu.transducers.piezoresistive import Piezoresistive

X = np.linspace(-8e-3, 8e-3, 6)
GRID = np.stack([*np.meshgrid(X, np.linspace(-6e-3, 6e-3, 5)), np.full((5, 6), 0.01)], -1)
MODELS = (
    tt.ContactProbe,
    tt.ContactDepthProbe,
    tt.KinematicTaxel,
    tt.ProximityTaxel,
    tt.ElastomerTaxel,
    tt.ElasticLayerTaxel,
)
FIELDS = {
    tt.ContactProbe: (("touch",), ""),
    tt.ContactDepthProbe: (("depth",), "m"),
    tt.KinematicTaxel: (("force", "torque"), "N, N m"),
    tt.ProximityTaxel: (("force", "torque"), "N, N m"),
    tt.ElastomerTaxel: (("displacement",), "m"),
    tt.ElasticLayerTaxel: (("pressure", "traction", "force", "displacement", "slip", "residual"), "Pa, N, m"),
}


def pressed(model, n_envs=None, *, transducers=(), **options):
    """A ball pressed 0.6 mm into a pad, and another far from it: ``(sim, ball, far, skin)``, one step taken."""
    scene = tt.Scene()
    pad = scene.add_body(tt.Box(size=(0.03, 0.03, 0.02)), name="pad", fixed=True)
    ball = scene.add_body(tt.Sphere(radius=0.01), name="ball", position=(0, 0, 0.0194))
    far = scene.add_body(tt.Box(size=(0.01, 0.01, 0.01)), name="far", position=(0, 0, 0.5))
    skin = scene.add_sensor(
        model(positions=GRID, radius=1e-3, **options), link=pad, name="skin", transducers=transducers
    )
    sim = scene.build(n_envs)
    sim.step()
    return sim, ball, far, skin


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("n_envs", [None, 3])
def test_a_reading_has_the_same_fields_on_the_host_and_on_the_device(model, n_envs):
    _sim, _ball, _far, skin = pressed(model, n_envs, electronics=tt.ElectronicsOptions(noise=1e-6))
    names, unit = FIELDS[model]
    assert skin.unit == unit and set(dir(skin.arrays)) == {*names, "packed", "contacts", "bad_poses"}
    for reading, arrays in ((skin.read(), skin.arrays), (skin.read_ground_truth(), skin.ground_truth_arrays)):
        assert (reading._fields if len(names) > 1 else names) == names
        for name in names:
            on_host = getattr(reading, name) if len(names) > 1 else reading
            on_device = np.from_dlpack(getattr(arrays, name))
            assert on_device.shape == on_host.shape and on_device.shape[: 2 + bool(n_envs)][-2:] == (5, 6)
            assert on_device == pytest.approx(on_host.astype(float), rel=1e-5, abs=1e-12)
            assert name in ("slip", "residual", "torque") or on_host.any()


def test_a_reading_unpacks_as_a_tuple():
    _sim, _ball, _far, skin = pressed(tt.KinematicTaxel)
    force, torque = skin.read()
    assert np.array_equal(force, skin.read().force) and np.array_equal(torque, skin.read().torque)


@pytest.mark.parametrize("model", [model for model in MODELS if "force" in FIELDS[model][0]])
def test_the_force_of_any_model_has_one_name(model):
    _sim, _ball, _far, skin = pressed(model, 2)
    assert np.array_equal(skin.read().force, skin.arrays.force.numpy())
    assert np.array_equal(skin.read().force[0].reshape(-1, 3), skin.quantity("force"))


def test_with_transducers_the_reading_is_their_signal():
    _sim, _ball, _far, skin = pressed(tt.ElasticLayerTaxel, 2, transducers=[Piezoresistive()])
    assert isinstance(skin.read(), np.ndarray) and skin.read().shape == (2, 5, 6)
    assert np.array_equal(skin.arrays.resistance.numpy(), skin.read()) and skin.unit == "Ohm"
    assert skin.quantities == ("resistance",)
    with pytest.raises(
        tt.SceneError, match=r"'skin' has no array 'force' \(arrays: resistance, packed, contacts, bad_poses\)"
    ):
        _ = skin.arrays.force


def test_a_skin_tells_its_taxels():
    _sim, _ball, _far, skin = pressed(tt.ContactDepthProbe, 2)
    assert skin.layout == (5, 6) and skin.n_taxels == 30
    assert np.allclose(skin.positions, GRID) and skin.normals.shape == (5, 6, 3) and (skin.normals[..., 2] == 1).all()
    assert skin.radii.shape == (5, 6) and (skin.radii == 1e-3).all()
    listed = tt.Scene()
    two = tt.ContactDepthProbe(positions=[(0, 0, 0), (0, 0, 1e-3)])
    assert listed.add_sensor(two, link=listed.add_body(fixed=True)).positions.shape == (2, 3)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("n_envs", [None, 3])
def test_contacts_are_told_by_body(model, n_envs):
    sim, ball, far, skin = pressed(model, n_envs)
    shape = () if n_envs is None else (n_envs,)
    for body, expected in ((ball, True), ("far", False), (None, True)):
        touches = skin.touching(body)
        assert touches.shape == shape and touches.dtype == bool and (touches == expected).all()
    assert skin.arrays.contacts.shape == (*shape, 3)
    sim.set_pose(ball, position=(0, 0, 0.0231))
    sim.set_pose(far, position=(0, 0, 0.0149))
    sim.step()
    assert not skin.touching(ball).any() and skin.touching(far).all() and skin.touching().all()


def test_what_is_not_asked_is_not_computed():
    sim, ball, _far, skin = pressed(tt.KinematicTaxel)
    before = [stage.name for stage in sim.plan.stages]
    skin.read(), skin.arrays.force.numpy()
    assert [stage.name for stage in sim.plan.stages] == before
    skin.touching(ball), skin.arrays.contacts.numpy()
    assert [stage.name for stage in sim.plan.stages] == [*before, "skin: contacts"]


@pytest.mark.parametrize("model", MODELS)
def test_a_pose_that_is_not_finite_is_no_missing_contact(model):
    sim, ball, far, skin = pressed(model, 3)
    assert not skin.touching(far).any()
    sim.set_pose(ball, position=(0, 0, 1.0))
    sim.set_pose(far, position=(np.nan, 0, 0), envs=[1])
    with pytest.raises(tt.PoseError, match="'far'"):
        sim.step()
    assert skin.touching(far).tolist() == skin.touching().tolist() == [False, True, False]
    assert not skin.touching(ball).any()
    assert skin.arrays.bad_poses.numpy().tolist() == [[0, 0, 0], [0, 0, 1], [0, 0, 0]]


@pytest.mark.parametrize("asked_before", [True, False])
def test_a_reset_ends_contacts_until_the_next_step(asked_before):
    sim, ball, _far, skin = pressed(tt.KinematicTaxel, 3)
    if asked_before:
        assert skin.touching(ball).all()
    sim.reset([1])
    assert skin.touching(ball).tolist() == [True, False, True]
    sim.step()
    assert skin.touching(ball).all()
    sim.reset()
    assert not skin.touching(ball).any()


def test_a_restored_state_has_its_contacts():
    sim, ball, _far, skin = pressed(tt.KinematicTaxel)
    assert skin.touching(ball)
    touching = sim.state()
    sim.set_pose(ball, position=(0, 0, 1.0))
    sim.step()
    assert not skin.touching(ball)
    sim.prepare_restore(touching)()
    assert skin.touching(ball)


def test_contacts_are_those_of_the_reading():
    """Where a layer's cells are smaller than its taxels, and where a thin plate has sunk below the taxels' points."""
    for model, options, where in (
        (tt.ElasticLayerTaxel, {"oversampling": 4}, (X[2] + 0.5e-3, 0.0, 0.0105)),
        (tt.ElasticLayerTaxel, {}, (0, 0, 0.0085)),
        (tt.ContactDepthProbe, {"depth_query": "ray"}, (0, 0, 0.0085)),
    ):
        sim, _ball, far, skin = pressed(model, **options)
        sim.set_pose("ball", position=(0, 0, 1.0))
        sim.set_pose(far, position=where)
        sim.step()
        assert np.any(skin.arrays.force.numpy() if model is tt.ElasticLayerTaxel else skin.read())
        assert skin.touching(far) and not skin.touching("ball")


def test_a_body_that_is_not_sensed_is_named():
    _sim, _ball, _far, skin = pressed(tt.KinematicTaxel, ignore=("far",))
    with pytest.raises(tt.SceneError, match="sensor 'skin' does not sense body 'far'; it senses: ball"):
        skin.touching("far")
    with pytest.raises(tt.SceneError, match="does not sense body 'pad'"):
        skin.touching("pad")


def test_before_the_scene_is_built_nothing_reads():
    scene = tt.Scene()
    skin = scene.add_sensor(tt.ContactDepthProbe(), link=scene.add_body(fixed=True), name="skin")
    for read in (skin.read, skin.touching, lambda: skin.arrays, lambda: skin.ground_truth_arrays):
        with pytest.raises(tt.SceneError, match="'skin' cannot be read yet; build the scene first"):
            read()


def test_a_model_of_ones_own_has_contacts_too():
    class Nothing(SensorModel[np.ndarray]):
        level = 0
        channels = ("scalar",)

        def compile(self, site):
            raw = site.zeros()
            return Compiled(truth=raw, raw=raw, stages=[])

    _sim, ball, far, skin = pressed(Nothing)
    assert skin.touching(ball) and not skin.touching(far) and isinstance(skin.arrays.contacts, wp.array)
