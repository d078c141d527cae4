"""The compiled choice of a meeting agrees with the reference."""

import numpy as np
import pytest
from throws import IN_AIR, chosen, plan_of, random_throws, throws_to_a_palm

from drake_pregrasp.grasping.catch_limits import CatchLimit
from drake_pregrasp.grasping.interception import choose_meeting
from drake_pregrasp.grasping.palm_paths import moved

meetings = pytest.importorskip("drake_pregrasp.fast.meetings")
BOTH = choose_meeting, meetings.compiled_choose_meeting


@pytest.mark.slow
def test_both_choose_the_same_meetings():
    limits = set()
    in_air = [(*thrown, IN_AIR) for thrown in throws_to_a_palm(20, 4)]
    for motion, palm, settings in [*random_throws(200, 3), *in_air]:
        first, other = [chosen(motion, palm, settings, choose=choose) for choose in BOTH]
        np.testing.assert_allclose(first, other, atol=1e-12)
        limits.add(first.limit)
        if first.limit != CatchLimit.NONE:
            continue
        kept, now = plan_of(first, palm, motion), 0.1
        palm, here = kept.object_at(now) + kept.offset_at(now), moved(motion, now)
        again = [chosen(here, palm, settings, now, kept, choose) for choose in BOTH]
        np.testing.assert_allclose(*again, atol=1e-12)
    assert len(limits) >= 5
