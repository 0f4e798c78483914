"""Where ElastomerTaxel and ProximityTaxel differ from Genesis, or keep what is questionable in it.

Each test shows both numbers; docs/differences.md is the table of them.
"""

import numpy as np
import pytest

import tactemu as tt
from tactemu.sensors.elastomer.dilation_kernels import spectral_layer
from tests.sensors.soft_skin_cases import Case
from tests.sensors.test_elastomer_taxel import TOP, grid, press


def test_anchors_survive_within_the_release_margin():
    """Largest shear [m] in steps 12 to 16 of c16, after a lift within the margin. Genesis's numbers: with its grid of
    distances, which forgets the margin, and with its exact distance to triangles, which keeps one point."""
    forgets = [0.0, 0.000259, 0.000521, 0.000784, 0.00105]
    keeps = [9.83e-05, 0.000357, 0.000618, 0.000881, 0.00115]
    case = Case("c16")
    shear = np.linalg.norm(case.play("float64")["s__out"], axis=-1).max(axis=(1, 2))[12:17]
    recorded = np.linalg.norm(case.reference("s__out"), axis=-1).max(axis=(1, 2))[12:17]
    assert recorded == pytest.approx(forgets, rel=5e-3, abs=1e-9)
    assert shear == pytest.approx(keeps, rel=5e-3)


def test_compressibility_is_a_mix_of_different_units():
    """In-plane motion of one press: m^2, m and a pure number, as in Genesis; a jump at both ends of the blend."""
    largest = {
        c: np.abs(press(grid(15, 15), depth=2e-3, compressibility=c)[..., :2]).max() for c in (1, 0.999, 0.001, 0)
    }
    assert largest[0.999] > 50 * largest[1] and largest[0] > 50 * largest[0.001]


def test_dilation_grows_with_the_number_of_taxels():
    """8 x 8 to 29 x 29 over the same area: 17 times, as in Genesis (the areas' ratio); 1 when areas weigh."""
    coarse, fine = grid(8, 8, du=14e-3 / 7), grid(29, 29, du=14e-3 / 28)
    ratio = np.abs(press(fine)).max() / np.abs(press(coarse)).max()
    assert ratio == pytest.approx((4 / 1) ** 2, rel=0.15)
    weighted = [np.abs(press(p, area_weighted=True)).max() for p in (coarse, fine)]
    assert weighted[1] / weighted[0] == pytest.approx(1.0, abs=0.15)


def test_other_sensors_change_nothing():
    """A 9 x 9 layer of 20 mm: Genesis's FFT box grows with the largest grid in the scene, and with it the reading
    (13 % in its own record). Here it is that of the sensor alone."""
    options = {"compressibility": 0.0, "elastomer_thickness": 20e-3, "shear_scale": 0.0}
    readings = []
    for neighbours in (0, 1):
        scene = tt.Scene()
        pad = scene.add_body(tt.Box(size=(0.08, 0.08, 0.02)))
        scene.add_body(tt.Sphere(radius=0.015), position=(0.0, 0.0, TOP + 0.0135))
        skin = scene.add_sensor(tt.ElastomerTaxel(positions=grid(9, 9), **options), link=pad)
        for _ in range(neighbours):
            scene.add_sensor(tt.ElastomerTaxel(positions=grid(40, 40, du=1e-3), **options), link=pad)
        sim = scene.build(dtype="float64")
        sim.step()
        readings.append(skin.read())
    assert np.array_equal(readings[0], readings[1])
    alone, beside = (spectral_layer((n, n), (2e-3, 2e-3), 20e-3)[0, 0, :9].max() for n in (32, 128))
    assert abs(beside / alone - 1) > 0.05


def test_the_layer_of_a_grid_is_periodic_unless_areas_weigh():
    """The last row of Genesis's spectrum breaks the symmetry of the axes by 0.05 %; the unbounded layer has it."""
    positions = grid(6, 11, du=1.5e-3, dv=2.5e-3)
    transposed = np.ascontiguousarray(positions.transpose(1, 0, 2))
    options = {"compressibility": 0.0, "elastomer_thickness": 0.5e-3}

    def asymmetry(**more):
        u = press(positions, **options, **more)[..., :2]
        return np.abs(press(transposed, **options, **more)[..., :2].transpose(1, 0, 2) - u).max() / np.abs(u).max()

    assert asymmetry() > 4e-4
    assert asymmetry(area_weighted=True) < 1e-12


def test_a_thick_layer_tends_to_no_motion_and_a_thin_one_to_a_limit():
    """q is limited to 1e-3 .. 30 as in Genesis: 1 nm and 2 nm read the same, and 0 is another weight altogether."""
    options = {"compressibility": 0.0}
    thin, thinner, none, thick = (
        np.abs(press(grid(8, 8), elastomer_thickness=h, **options)[..., :2]).max() for h in (2e-9, 1e-9, 0.0, 10.0)
    )
    assert thin == pytest.approx(thinner, rel=1e-6)
    assert thick < 1e-9 * thin and none != pytest.approx(thin, rel=0.5)


def test_markers_bulge_outward_even_under_the_press():
    assert (press(grid(8, 8))[..., 2] > 0).all()


def test_a_stuck_point_never_slips():
    """Shear grows with the way, without a limit by friction: ten times the way, ten times the shear, as in Genesis."""
    shared = {"dilate_scale": 0.0, "shear_scale": 1.0, "lambda_s": 0.0}
    short, far = (np.abs(press(grid(4, 4), slide=way, **shared)).max() for way in (1e-3, 1e-2))
    assert far / short == pytest.approx(10.0, rel=1e-3)


def test_radius_and_its_noise_mean_nothing_to_an_elastomer():
    positions = grid(6, 6)
    noisy = {"radius": 0.02, "imperfections": tt.ImperfectionOptions(radius_noise=0.01)}
    assert np.array_equal(press(positions, radius=1e-4), press(positions, **noisy))


def test_two_fixed_bodies_are_felt():
    scene = tt.Scene()
    pad = scene.add_body(tt.Box(size=(0.08, 0.08, 0.02)), fixed=True)
    scene.add_body(tt.Sphere(radius=0.015), fixed=True, position=(0, 0, TOP + 0.012))
    skin = scene.add_sensor(tt.ElastomerTaxel(positions=grid(8, 8)), link=pad)
    sim = scene.build()
    sim.step()
    assert skin.read().any()
