"""Which landmarks are near a point."""

import numpy as np
import pytest

from seo_slam.errors import FrameError
from seo_slam.mapping.nearby import require_point, rows_within


def test_nearest_first_border_included_lower_id_on_a_tie():
    positions_m = np.array([[2.0, 0, 0], [-1.0, 0, 0], [1.0, 0, 0], [0, 0, 0.5]])
    assert rows_within(positions_m, np.array([4, 9, 3, 7]), np.zeros(3), 1.0).tolist() == [3, 2, 1]
    assert rows_within(np.zeros((0, 3)), np.zeros(0, dtype=np.int64), [0, 0, 0], 1.0).tolist() == []


@pytest.mark.parametrize(("point", "radius_m"), [([0, 0], 1.0), ([0, 0, np.inf], 1.0), (np.zeros((1, 3)), 1.0), ([0, 0, 0], -0.1)])
def test_what_is_no_ball_is_refused(point, radius_m):
    with pytest.raises(FrameError, match=r"p_world|radius_m"):
        require_point(point, radius_m)
