"""ElastomerTaxel and ProximityTaxel read what Genesis reads, where its result is well defined."""

import numpy as np
import pytest

from tests.sensors.soft_skin_cases import Case

TOLERANCE = {"float64": 1e-9, "float32": 2e-5}
"""Of the largest reading of a case."""


def largest_error(case: Case, readings: dict[str, np.ndarray], name: str, steps=slice(None)) -> float:
    reference = case.reference(name)
    return float(np.abs(readings[name] - reference)[steps].max() / np.abs(reference).max())


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("name", ["c06", "c07", "c08", "c10", "c12", "c14"])
def test_readings_match(name, dtype):
    case = Case(name)
    readings = case.play(dtype)
    assert {key.split("__")[0] for key in readings} == {sensor["key"] for sensor in case.meta["sensors"]}
    for reading in readings:
        assert largest_error(case, readings, reading) < TOLERANCE[dtype], reading


@pytest.mark.gpu
@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("name", ["c06", "c07", "c08", "c10", "c12", "c14"])
def test_readings_match_on_a_gpu(name, dtype):
    case = Case(name)
    readings = case.play(dtype, device="cuda:0")
    for reading in readings:
        assert largest_error(case, readings, reading) < TOLERANCE[dtype], reading


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_points_are_held_within_the_release_margin(dtype):
    """c16 lifts by 0.05 mm within a margin of 0.1 mm (steps 9 to 11). Genesis lets go of points that have left the
    bounding box of the skin, whatever the margin, so that their anchors are new in steps 12 to 16; here they are the
    old ones. All other steps agree, those after the lift by 0.3 mm too."""
    case = Case("c16")
    readings = case.play(dtype)
    differing = slice(12, 17)
    same = np.r_[0:12, 17:23]
    assert largest_error(case, readings, "s__out", same) < TOLERANCE[dtype]
    assert largest_error(case, readings, "s__out", differing) > 1e-2
    held = case.play(dtype, release_threshold=0.0)  # without a margin both let go
    assert largest_error(case, held, "s__out") < TOLERANCE[dtype]


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_radius_noise_spoils_only_the_measured_proximity(dtype):
    """c18: the truth is exact, the measured branch agrees in its spread, and an elastomer ignores the option."""
    case = Case("c18")
    readings = case.play(dtype)
    for exact in ("prnoise__force_gt", "prnoise__torque_gt", "ernoise__out", "ernoise__out_gt"):
        assert largest_error(case, readings, exact) < TOLERANCE[dtype], exact
    ours, theirs = (r["prnoise__force"][..., 2] for r in (readings, case.data))
    truth = readings["prnoise__force_gt"][..., 2]
    touched = truth > 0.2 * truth.max()
    spread = [float(np.std(r[touched] / truth[touched])) for r in (ours, theirs)]
    mean = [float(np.mean(r[touched] / truth[touched])) for r in (ours, theirs)]
    assert spread[0] == pytest.approx(spread[1], rel=0.15)
    assert mean[0] == pytest.approx(mean[1], abs=4 * spread[1] / np.sqrt(touched.sum()))
