"""Pictures of hands at four moments."""

from itertools import pairwise

import numpy as np

from drake_pregrasp import load_scenario
from drake_pregrasp.studies.grasp_pictures import picture_grasp


def test_a_hand_is_seen_at_four_moments_that_differ():
    picture = picture_grasp(load_scenario("grasp_five_finger", text="{simulation_duration: 8.0}"))
    assert picture.dtype == np.uint8
    height, width, _ = picture.shape
    assert width == 4 * height + 3 * 8
    moments = [picture[:, k * (height + 8) :][:, :height].astype(float) for k in range(4)]
    for first, second in pairwise(moments):
        assert np.mean(np.any(np.abs(first - second) > 30, axis=2)) > 0.01
    for moment in moments:  # Something is there, and not everywhere.
        background = np.mean(np.all(np.abs(moment - moment[0, 0]) < 2, axis=2))
        assert 0.2 < background < 0.9
