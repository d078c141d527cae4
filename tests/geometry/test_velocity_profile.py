import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.geometry.motion_profiles import VelocityProfile


def test_positions_are_the_integral_of_velocities_that_are_linear_between_rows():
    """The same as a spline and its antiderivative; beyond the last row the last ones go on."""
    times = [0.0, 0.5, 2.0, 2.25]
    v = np.array([[0.0, 1.0], [0.4, -1.0], [-0.2, 3.0], [0.1, 0.0]])
    profile = VelocityProfile(np.column_stack([times, v]).tolist())
    spline = make_interp_spline(times, v, k=1)
    for time in (0.0, 0.1, 0.5, 1.7, 2.0, 2.2, 2.25):
        positions, velocities = profile.at(time)
        np.testing.assert_allclose(positions, spline.antiderivative()(time), atol=1e-14)
        np.testing.assert_allclose(velocities, spline(time), atol=1e-14)
    positions, velocities = profile.at(5.25)
    np.testing.assert_allclose(positions, spline.antiderivative()(2.25) + 3 * v[-1], atol=1e-14)
    np.testing.assert_array_equal(velocities, v[-1])


@pytest.mark.parametrize(
    "rows", [[], [[0.0]], [[0.0, 1.0], [1.0]], [[1.0, 1.0]], [[0.0, 1.0], [0.0, 2.0]]]
)
def test_rows_whose_times_do_not_increase_from_0_are_refused(rows):
    with pytest.raises(InvalidArgumentError, match="a profile"):
        VelocityProfile(rows)
