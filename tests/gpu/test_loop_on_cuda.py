"""The loop that stays on the device: poses in, readings out, resets, graphs; against the same from the host.

Run on a machine with a CUDA device: ``python -m pytest tests/gpu/test_loop_on_cuda.py``.
"""

import numpy as np
import pytest
import warp as wp

import tactemu as tt
from tactemu.base.errors import PoseError, SceneError
from tactemu.sensors.layer.reading import FORCE
from tactemu.sensors.sensor import reading_array
from tests.sensors.test_poses_on_the_device import N_ENVS, mujoco_warp, newton, one_array, scene, truth
from tests.sensors.test_views import GRID

pytestmark = pytest.mark.gpu
DEVICE = "cuda:0"


def to_device(value, device=DEVICE):
    """What a convention gives, on the device: arrays strided as they were, through one array that is twice as wide."""
    if isinstance(value, tuple):
        return to_device(value[0], device), value[1]
    if isinstance(value, wp.array):
        return wp.clone(value, device=device)
    if hasattr(value, "__dlpack__"):
        host = np.from_dlpack(value)
        wide = wp.array(np.concatenate([host, np.full_like(host, np.nan)], -1), device=device)
        return wide[:, :, : host.shape[-1]] if host.ndim == 3 else wp.array(host, device=device)
    return value


@pytest.mark.parametrize("convention", [one_array, newton, mujoco_warp])
def test_poses_of_another_simulator(convention):
    t = 0.02
    expected = truth(t)
    sim, skin = scene(device=DEVICE)
    sim.step()
    given = {
        name: value if name in ("com", "index", "order") else to_device(value) for name, value in convention(t).items()
    }
    sim.bind_poses(**given)
    for _ in range(4):  # launch by launch, captured, from the graph
        sim.step()
        tolerance = 3e-4 if convention is newton else 1e-5
        assert np.abs(np.concatenate(skin.read(), -1) - expected).max() <= tolerance * np.abs(expected).max()


def test_a_pose_array_that_anybody_writes():
    t = 0.02
    sim, skin = scene(device=DEVICE)
    poses = sim.pose_array
    given = wp.array(np.nan_to_num(one_array(t)["poses"], nan=0.0), dtype=wp.float64, device=DEVICE)
    given[:, 1].assign(poses[:, 1])  # of the floor
    for _ in range(4):
        wp.copy(poses, given)
        sim.step()
    expected = truth(t)
    assert np.abs(np.concatenate(skin.read(), -1) - expected).max() <= 1e-5 * np.abs(expected).max()
    sim.set_pose("tool", position=(0, 0, 5.0), envs=[1])  # from the host, which must know what the device wrote
    sim.step()
    assert not skin.read().force[1].any() and np.abs(np.concatenate(skin.read(), -1)[0] - expected[0]).max() < 1e-4


def test_torch_writes_poses_and_reads_forces_without_a_copy():
    torch = pytest.importorskip("torch", reason="torch is not installed")
    t = 0.02
    sim, skin = scene(device=DEVICE)
    poses, force = torch.from_dlpack(sim.pose_array), torch.from_dlpack(skin.arrays.force)
    given = torch.as_tensor(one_array(t)["poses"], device=DEVICE)
    for _ in range(4):
        poses[:, ::2] = given[:, ::2]
        sim.step()
    expected = truth(t)
    assert force.data_ptr() == reading_array(skin).ptr
    assert np.abs(force.cpu().numpy() - expected[..., :3]).max() <= 1e-5 * np.abs(expected).max()
    mask = torch.zeros(N_ENVS, dtype=torch.bool, device=DEVICE)
    mask[2] = True
    sim.reset(mask)
    assert not force[2].any() and force[1].any()


def test_jax_reads_forces():
    jax = pytest.importorskip("jax", reason="JAX is not installed")
    sim, skin = scene(device=DEVICE)
    sim.set_pose("tool", position=(0, 0, 0.018))
    sim.step()
    wp.synchronize()
    packed = np.asarray(jax.dlpack.from_dlpack(skin.arrays.packed))
    assert np.array_equal(packed[..., skin.model.layouts["force"]], skin.read().force)


def layer(device, **options):
    built = tt.Scene(dt=1e-3)
    pad = built.add_body(tt.Box(size=(0.04, 0.04, 0.02)), fixed=True, name="pad")
    ball = built.add_body(tt.Sphere(radius=0.01), name="ball", position=(0, 0, 0.0195))
    noisy = tt.ElectronicsOptions(noise=1e-3)
    model = tt.ElasticLayerTaxel(positions=GRID, electronics=noisy, **options)
    skin = built.add_sensor(model, link=pad, name="skin")
    return built.build(N_ENVS, device=device), ball, skin


def slide(sim, ball, k):
    sim.set_pose(
        ball, position=np.c_[np.linspace(-1e-3, 1e-3, N_ENVS) + k * 1e-4, np.zeros(N_ENVS), np.full(N_ENVS, 0.0194)]
    )


def test_resets_by_a_mask_are_those_by_index():
    """Of all that an elastic layer remembers; the first is launched, the second captured, the third from the graph."""
    readings = []
    for by_mask in (False, True):
        sim, ball, skin = layer(DEVICE)
        found = []
        for k in range(8):
            slide(sim, ball, k)
            sim.step()
            if k % 2:
                mask = np.arange(N_ENVS) % 3 == k % 3
                chosen = wp.array(mask, dtype=wp.bool, device=DEVICE) if by_mask else np.flatnonzero(mask)
                sim.reset(chosen)
                assert not reading_array(skin).numpy()[mask].any()
                slide(sim, ball, k)
            found.append(reading_array(skin).numpy())
        readings.append(np.array(found))
    assert np.array_equal(*readings) and readings[0].any()


def test_views_and_pinned_readings():
    sim, ball, skin = layer(DEVICE)
    views = {name: getattr(skin.arrays, name) for name in ("force", "pressure", "traction", "displacement")}
    out = skin.host_array()
    assert out.pinned
    for k in range(4):
        slide(sim, ball, k)
        sim.step()
        reading = skin.read()
        pinned = skin.read(out=out)
        assert np.shares_memory(pinned.force, out.numpy())
        assert all(np.array_equal(a, b) for a, b in zip(reading, pinned))
        for name, array in views.items():
            expected = getattr(reading, name)
            assert np.abs(array.numpy() - expected).max() <= 1e-5 * np.abs(expected).max(), name
    assert views["force"].ptr != views["pressure"].ptr and skin.read().traction.any()


def test_large_readings_are_copied_by_threads(monkeypatch):
    monkeypatch.setattr("tactemu.sensors.sensor.MIN_STAGED_BYTES", 0)
    monkeypatch.setattr("tactemu.plan.plan.MIN_SHARED_COPY_BYTES", 0)
    sim, ball, skin = layer(DEVICE)
    kept = []
    for k in range(3):
        slide(sim, ball, k)
        sim.step()
        kept.append((skin.read(), reading_array(skin).numpy()[..., FORCE].copy()))
    for reading, force in kept:  # none of them lies in the memory of another
        assert np.array_equal(reading.force.reshape(N_ENVS, -1, 3), force) and force.any()
    sim.close()


def test_a_step_in_a_graph_of_ones_own():
    """Poses written, a step and a reset in one graph, replayed, give what they give one by one."""
    t = 0.02
    found = []
    for captured in (False, True):
        sim, skin = scene(device=DEVICE)
        with pytest.raises(SceneError, match="one step before"), wp.ScopedCapture(DEVICE):
            sim.step()
        given = wp.array(np.nan_to_num(one_array(t)["poses"]), dtype=wp.float64, device=DEVICE)
        sim.bind_poses(given)
        mask = wp.array([0, 1, 0, 0, 0], dtype=wp.bool, device=DEVICE)
        sim.step()
        sim.reset(mask)
        total = wp.zeros_like(reading_array(skin))
        if captured:
            with wp.ScopedCapture(DEVICE) as capture:
                sim.reset(mask)
                sim.step()
                wp.copy(total, reading_array(skin))
            assert capture.graph is not None
            for _ in range(3):
                wp.capture_launch(capture.graph)
        else:
            for _ in range(3):
                sim.reset(mask)
                sim.step()
                wp.copy(total, reading_array(skin))
        found.append((total.numpy(), int(sim.context.step.numpy()[0])))
    assert np.array_equal(found[0][0], found[1][0]) and found[0][1] == found[1][1] == 4


def test_what_a_graph_cannot_hold_is_said():
    sim, _skin = scene(device=DEVICE)
    sim.step()
    sim.step()
    sim.set_pose("tool", position=(0, 0, 1.0))
    with pytest.raises(SceneError, match="not sent yet"), wp.ScopedCapture(DEVICE):
        sim.step()
    sim.step()


def test_a_nan_is_seen_on_the_device():
    sim, skin = scene(device=DEVICE)
    rows = one_array(0.0)["poses"]
    rows[3, 2, 4] = np.nan
    rows[:, 1] = 0.0
    sim.bind_poses(wp.array(rows, dtype=wp.float64, device=DEVICE))
    for _ in range(3):
        sim.step()
    assert np.argwhere(skin.arrays.bad_poses.numpy()).tolist() == [[3, 2]]
    with pytest.raises(PoseError, match="body 'tool', environment 3, step 3"):
        sim.check()
    assert np.isnan(skin.read().force[3]).all() and np.isfinite(np.delete(skin.read().force, 3, 0)).all()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"position": np.zeros((N_ENVS, 3, 3))}, "on cpu, the simulation on cuda:0"),
        ({"position": wp.zeros((N_ENVS, 3, 3), dtype=wp.float32, device="cpu")}, "on cpu, the simulation on cuda:0"),
    ],
)
def test_arrays_of_the_host_are_refused(wrong, said):
    sim, _skin = scene(device=DEVICE)
    with pytest.raises(SceneError, match=said):
        sim.bind_poses(**wrong)


def test_masks_that_do_not_fit_are_refused():
    sim, _skin = scene(device=DEVICE)
    sim.step()
    for mask, said in (
        (wp.zeros(4, dtype=wp.bool, device=DEVICE), r"must have shape \(5,\)"),
        (wp.zeros(5, dtype=wp.int32, device=DEVICE), "must be a mask"),
        (wp.zeros(5, dtype=wp.bool, device="cpu"), "on cpu"),
    ):
        with pytest.raises(SceneError, match=said):
            sim.reset(mask)


def test_contacts_by_body_are_those_of_a_cpu_and_part_of_the_graph():
    found = []
    for device in ("cpu", DEVICE):
        sim, ball, skin = layer(device)
        seen = []
        for k in range(6):  # the plan is captured once the flags have been asked for, and again
            slide(sim, ball, k)
            if k % 2:
                sim.set_pose(ball, position=(0, 0, 1.0), envs=[1])
            sim.step()
            seen.append(skin.touching(ball))
            assert np.array_equal(skin.arrays.contacts.numpy()[:, ball.index] > 0, seen[-1])
        found.append(np.array(seen))
    assert np.array_equal(*found) and found[0].any() and not found[0].all()
