"""Options of transducers at the rim: refused in a sentence, or a reading that is a number."""

import typing

import numpy as np
import pytest
import trimesh

import tactemu as tt
from tactemu.base.errors import SceneError
from tactemu.transducers.magnetic import Magnetic, radius_of
from tactemu.transducers.registry import TRANSDUCERS, make_transducer, transducer_class

GRID = np.stack([*np.meshgrid(np.linspace(-4e-3, 4e-3, 5), np.linspace(-4e-3, 4e-3, 5)), np.full((5, 5), 0.01)], -1)


def skin_with(*transducers, grid=GRID):
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.05, 0.05, 0.02)), fixed=True)
    scene.add_body(tt.Sphere(radius=0.01), position=(0, 0, 0.0195), name="ball")
    model = tt.KinematicTaxel(positions=grid, radius=1e-3, normal_stiffness=400.0)
    sensor = scene.add_sensor(model, link=pad, transducers=transducers)
    sim = scene.build(dtype="float64")
    sim.step()
    return sensor.read()


def numbers_of(kind):
    hints = typing.get_type_hints(transducer_class(kind))
    return [name for name, hint in hints.items() if hint is float or hint == float | None]


@pytest.mark.parametrize("kind", TRANSDUCERS)
def test_no_number_of_a_transducer_may_be_none(kind):
    found = numbers_of(kind)
    assert found
    for name in found:
        for value in (np.nan, np.inf, "x", True, [1, [2]]):
            with pytest.raises(SceneError, match=f"here: .*: {name}"):
                make_transducer("here", {"kind": kind, name: value})


@pytest.mark.parametrize(
    "options",
    [
        {"earth": [np.nan, 0, 0]}, {"earth": [1, 2]}, {"grid": [-1, 2]}, {"grid": [2.5, 2]}, {"grid": [2]},
        {"moments": []}, {"neighbours": [["ball", [0, np.nan, 0], [0, 0, 1]]]},
        {"neighbours": [["ball", [0, 0], [0, 0, 1]]]},
        {"neighbours": [["ball", [0, 0, 0]]]},
    ],
)  # fmt: skip
def test_shapes_of_a_magnetic_skin_are_checked(options):
    with pytest.raises(SceneError, match=r"^here: Magnetic: (earth|grid|moments|neighbours)"):
        make_transducer("here", {"kind": "magnetic", **options})


def test_a_magnet_on_its_chip_reads_the_field_inside_it():
    moment = np.array([0, 0, 2e-4])
    magnetic = Magnetic(magnets=[[0, 0, 0]], moments=[moment.tolist()], chip_depth=0.0, compliance=0.0)
    field = skin_with(magnetic)
    assert np.isfinite(field).all()
    assert field[2, 2] == pytest.approx(2e-7 * moment / radius_of(moment[None])[0] ** 3, rel=1e-9)


def test_a_magnet_follows_all_taxels_within_four_spreads():
    """The documented weights, in NumPy."""
    magnetic = Magnetic(
        magnets=[[1e-3, 0, 1e-3]], moments=[[0, 0, 1e-4]], spread=4e-3, compliance=1e-3, chip_depth=4e-3
    )
    positions = GRID.reshape(-1, 3)
    places, _ = magnetic.places(positions)
    taxels, shares = magnetic.shares(places, positions)
    assert len(taxels[0]) == 25
    apart = np.linalg.norm(places[0] - positions, axis=1)
    weights = np.exp(-0.5 * (apart / 4e-3) ** 2)
    assert shares[0] == pytest.approx((weights / max(1, weights.sum()))[taxels[0]], rel=1e-12)


def test_one_taxel_alone_has_the_area_of_its_probe():
    from tactemu.transducers.capacitive import Capacitive

    assert np.isfinite(skin_with(Capacitive(), grid=GRID[2:3, 2:3])).all()
    assert (skin_with(Capacitive(), grid=GRID[2:3, 2:3]) > 0).all()


def test_a_mesh_of_metres_is_asked_about(tmp_path):
    trimesh.creation.box((20, 20, 20)).export(tmp_path / "mm.stl")
    with pytest.raises(SceneError, match=r"mm.stl is 20 m long; .* give scale = 0.001"):
        tt.Mesh.from_file(tmp_path, path="mm.stl")
    tt.Mesh.from_file(tmp_path, path="mm.stl", scale=0.001)
