"""Readings of Genesis, step by step, wherever they are well defined.

Left out: steps on which its contact list is empty though the bodies are within a probe radius (its gate), and probes
outside the distance grid of an object (it reads 0 there). `test_differences.py` shows what we read instead.
"""

import functools

import numpy as np
import pytest

import tactemu as tt
from tests.sensors.genesis_case import Case

TOLERANCE = {"float64": 1e-9, "float32": 2e-5}
CASES = {
    "c01_contact": (lambda case: tt.Sphere(radius=0.02), ("depth", "depth_big", "bool", "schmitt")),
    "c03_contact": (lambda case: case.grid(1), ("lin", "hertz")),
    "c10_contact": (lambda case: case.grid(1), ("depth", "bool", "kin")),
    "c14_contact": (lambda case: tt.Sphere(radius=0.018), ("kin", "depth")),
}


@functools.cache
def replayed(name: str, dtype: str):
    case = Case(name)
    shape, keys = CASES[name]
    return case, case.replay(shape(case), keys, dtype)


def inside_grid(case: Case, key: str) -> np.ndarray:
    """Which probes are where Genesis knows distances, shape (T, envs, n)."""
    probes = np.asarray(case.options(key)["probe_local_pos"], float).reshape(-1, 3)
    world = case.arrays["link_pos"][:, :, 0, None] + rotate(case.arrays["link_quat"][:, :, 0, None], probes)
    turn = case.arrays["geom_quat"][:, :, 1, None] * [1, -1, -1, -1]
    local = rotate(turn, world - case.arrays["geom_pos"][:, :, 1, None])
    to_index = case.arrays["g1_sdf_T"]
    index = local @ to_index[:3, :3].T + to_index[:3, 3]
    return ((index > 0) & (index < np.array(case.arrays["g1_sdf_val"].shape) - 1)).all(-1)


def rotate(q, v):
    u = np.broadcast_to(q[..., 1:], np.broadcast_shapes(q[..., 1:].shape, v.shape))
    t = 2 * np.cross(u, v)
    return v + q[..., :1] * t + np.cross(u, t)


def well_defined(case: Case, key: str, shape: tuple) -> np.ndarray:
    """Mask of a reading of this shape, (T, [envs,] layout[, 3])."""
    touching = case.arrays["n_contacts"] > 0
    n = np.asarray(case.options(key)["probe_local_pos"]).size // 3
    mask = np.broadcast_to(touching[..., None], (*touching.shape, n))
    if "g1_sdf_T" in case.arrays:
        mask = mask & inside_grid(case, key)
    vector = len(shape) == len(np.shape(case.options(key)["probe_local_pos"])) + 1 + case.batched
    head = shape[:-1] if vector else shape
    mask = mask.reshape(head)
    return np.broadcast_to(mask[..., None], shape) if vector else mask


BRANCHES = [(name, key, branch) for name in CASES for key in CASES[name][1] for branch in ("", "_gt")]


@pytest.mark.parametrize("dtype", TOLERANCE)
@pytest.mark.parametrize(("name", "key", "branch"), [b for b in BRANCHES if b[0] != "c14_contact" or b[2]])
def test_reads_what_genesis_reads(name, key, branch, dtype):
    case, readings = replayed(name, dtype)
    for part, ours, theirs in case.parts(key, readings, branch):
        mask = well_defined(case, key, theirs.shape)
        assert mask.mean() > 0.3, part
        if ours.dtype == bool:
            assert (ours[mask] == theirs[mask]).all()
            continue
        tolerance = 1e-6 if name == "c01_contact" and dtype == "float32" else TOLERANCE[dtype]
        assert np.abs(ours - theirs)[mask].max() <= tolerance * np.abs(theirs).max(), part


@pytest.mark.parametrize("key", ["depth", "depth_big", "schmitt"])
def test_its_raycast_is_our_distance_to_a_mesh(key):
    """To float32 (mesh queries always are), except where it reads 0 because a probe is deeper than its radius."""
    case = Case("c02_contact")
    mesh = tt.Mesh(source=(case.arrays["g1_verts"], case.arrays["g1_faces"]))
    readings = case.replay(mesh, (key,), "float32", gated=True)
    ((_part, ours, theirs),) = case.parts(key, readings, "_gt")
    depths = np.array(case.replay(mesh, ("depth",), "float32", gated=True)["depth"]["_gt"])
    radius = case.options(key)["probe_radius"]
    too_deep = depths > 2 * case.options("depth")["probe_radius"] if radius < 0.01 else np.zeros_like(depths, bool)
    assert too_deep.mean() < 0.05
    if key == "schmitt":
        forgotten = too_deep.any(0)  # its trigger lets go when depth falls to 0
        assert np.array_equal(ours[:, ~forgotten], theirs[:, ~forgotten])
    else:
        assert np.abs(ours - theirs)[~too_deep].max() < 2e-6 * theirs.max()
        assert too_deep.any() == (key == "depth") and not theirs[too_deep].any()


GATED = {
    "c05_contact": (tt.Sphere(radius=0.02), ("k3g", "gain", "all")),
    "c13_contact": (
        tt.Sphere(radius=0.02), ("delay", "hist", "biasres", "hyst", "dead", "cbias", "chyst", "kdelay", "khist"),
    ),
    "c14_contact": (tt.Sphere(radius=0.018), ("kin",)),
}  # fmt: skip


@pytest.mark.parametrize("dtype", TOLERANCE)
@pytest.mark.parametrize("name", GATED)
def test_whole_readings_with_all_imperfections(name, dtype):
    """Crosstalk, gain, hysteresis, bias, resolution, dead taxels, thresholds, delay, history, resets, in one go. The
    object is taken away while Genesis's contact list is empty, so that its memory is comparable on every step."""
    case = Case(name)
    shape, keys = GATED[name]
    readings = case.replay(shape, keys, dtype, gated=True)
    for key in keys:
        rounds = case.options(key).get("resolution", 0.0)
        for branch in ("", "_gt"):
            for part, ours, theirs in case.parts(key, readings, branch):
                assert ours.shape == theirs.shape
                if ours.dtype == bool:
                    assert (ours == theirs).mean() >= (1.0 if dtype == "float64" else 0.995)
                    continue
                error = np.abs(ours - theirs) / np.abs(theirs).max()
                if dtype == "float32" and rounds and not branch:  # a half may round either way
                    error = error[error < 0.9 * rounds / np.abs(theirs).max()]
                assert error.max() <= TOLERANCE[dtype], (key, part, branch)


def test_an_environment_that_is_reset_reads_zero_and_the_others_go_on():
    case = Case("c14_contact")
    alone = case.replay(tt.Sphere(radius=0.018), ["kin"], "float64")["kin"][""]
    case.meta["events"] = []
    undisturbed = case.replay(tt.Sphere(radius=0.018), ["kin"], "float64")["kin"][""]
    for before, after in zip(undisturbed, alone):
        assert np.array_equal(before.force[[0, 2]], after.force[[0, 2]])
    differ = [t for t in range(case.n_steps) if not np.array_equal(undisturbed[t].force[1], alone[t].force[1])]
    assert differ and differ[0] == 18  # hysteresis has forgotten
