"""The solvers of small skins in a GPU's shared memory, run by one thread of a CPU, against those of a CPU."""

import numpy as np
import pytest
import warp as wp

from tests.sensors.elastic_layer_rig import LayerRig, coordinates

LARGE, SMALL = (4e-4, (0.2, 0.4)), (4e-5, (4.2, 2.4))


@pytest.mark.parametrize("cells", [(32, 32), (29, 32), (32, 16), (12, 30)])
@pytest.mark.parametrize(("depth", "shift"), [LARGE, SMALL])
def test_complex_transforms_solve_as_real_ones_do(cells, depth, shift):
    """Windows and surfaces have all combinations of transforms of 32 and 64; a small contact moves the surface before
    and behind its window."""
    x, y = coordinates(max(cells), 5e-4, shift)
    overlap = (depth - (x**2 + y**2) / 1.2e-2)[: cells[0], : cells[1]]
    results = []
    for lanes in (None, 1):
        rig = LayerRig(cells, 5e-4, 1e5, 0.45, 4e-3, mu=0.4, coupled=True, lanes=lanes, real=wp.float64)
        pressure = rig.press(overlap)
        rig.rub(0.0)
        results.append([pressure, *rig.rub(3e-5, 1e-5), *rig.surface(), rig.state.iterations.numpy()])
    for one, other in zip(*results):
        assert np.abs(one).max() > 0
        np.testing.assert_allclose(one, other, atol=1e-11 * np.abs(one).max())
