"""Forces and torques of taxels together, by link."""

import numpy as np
import pytest

from firmware_protocols import points, stack

THUMB, INDEX, PALM = (points({name: (0.0, 0.1, 0.0)}, link=name) for name in ("thumb", "index", ""))
FORCES = np.array([(0.0, 0.0, -2.0), (1.0, 0.0, 0.0)])


@pytest.mark.parametrize(
    ("about", "expected"),
    [
        (THUMB, [[0, 0, -2, -0.2, 0, 0]]),
        (stack(INDEX, THUMB), [[1, 0, 0, 0, 0, -0.1], [0, 0, -2, -0.2, 0, 0]]),
        (PALM, [[1, 0, -2, -0.2, 0, -0.1]]),
        (stack(PALM, points({"ring": (0, 0, 0)}, link="ring")), [[1, 0, -2, -0.2, 0, -0.1], [0] * 6]),
    ],
)
def test_a_point_on_a_link_counts_the_taxels_on_it_and_one_on_none_all(about, expected):
    layout = stack(*(points({name: (0.0, 0.2, 0.0)}, link=name) for name in ("thumb", "index")))
    np.testing.assert_allclose(layout.wrenches(FORCES, about), expected, atol=1e-12)
