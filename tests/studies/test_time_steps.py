"""Time steps of the studies of grasps: with half of them, the verdicts are the same."""

import pytest
from conftest import LACKING_HANDS

from drake_pregrasp.studies.grasps.goal_sources import GOAL_SOURCES
from drake_pregrasp.studies.study_file import load_study
from drake_pregrasp.studies.study_run import StudyRun

CASES = [
    ("static_versus_dynamic", "two_lost", "fixed_plan", {}),
    ("household", "five_finger_hand", "", {"object": "mug"}),
    ("tall_boxes", "allegro_hand", "", {}),
    ("random_boxes_gripper", "", "", {}),
    ("engines", "shadow_hand", "drake", {"object": "cylinder"}),
]


def row_of(name, condition, method, point, share):
    """The last row of a run with a seed that no results use, and a share of the time step."""
    chosen = {"conditions": [condition] * bool(condition), "methods": [method] * bool(method)}
    own = next(iter(load_study(name, **chosen).bases.values()))["plant_config"]["time_step"]
    text = f"{{overrides: {{plant_config: {{time_step: {share * own}}}}}}}"
    study = load_study(name, text=text, seeds=1, first_seed=3, **chosen)
    (job,) = [job for job in study.jobs() if point.items() <= job.items()]
    return StudyRun(study, GOAL_SOURCES)(job)[-1]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "condition", "method", "point"), CASES)
def test_half_the_time_step_changes_no_verdict(name, condition, method, point):
    if lack := LACKING_HANDS.get(condition, ""):
        pytest.skip(lack)
    one, half = (row_of(name, condition, method, point, share) for share in (1.0, 0.5))
    assert (one["held"], one["clean"]) == (half["held"], half["clean"])
    assert one["cause"] == half["cause"]
    if one["held"]:
        assert one["drift_mm_per_min"] == pytest.approx(half["drift_mm_per_min"], rel=0.6, abs=1.0)
