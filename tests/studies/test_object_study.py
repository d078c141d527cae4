"""The study of objects: which ones are drawn and fit, the rows of trials, resuming, the report."""

import contextlib
import importlib.util
import json
import zlib

import numpy as np
import pandas as pd
import pytest
from drake_pregrasp.studies.objects import object_sets, objects_command
from drake_pregrasp.studies.objects.object_report import cause_table, share_table
from drake_pregrasp.studies.objects.object_sets import drawn_objects, fits, opening
from drake_pregrasp.studies.objects.object_trial import ObjectJob, make_scenario, run_trial
from drake_pregrasp.studies.objects.objects_command import object_jobs, study_objects

from drake_pregrasp.cli import main
from drake_pregrasp.config.object_config import Box, Cylinder, Mesh
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.simulation.hand_file import load_hand, made_hand

HAND = "five_finger_hand"
CAUSES = ("", "slipped", "refused: reach", "knocked over")


def made_up_trial(job: ObjectJob):
    """Returns a row that follows from the job alone."""
    cause = CAUSES[zlib.crc32(repr(tuple(job)).encode()) % len(CAUSES)]
    moved = np.nan if cause.startswith("refused") else 0.5
    measures = {"slip_mm": 0.3, "tilt_deg": 1.0, "pushed_before_squeeze_mm": moved}
    return {"held": not cause, "cause": cause, "gave_up": cause, **measures}


def failing_trial(job: ObjectJob):
    raise ValueError("it ran again")


JOBS = object_jobs(
    "primitives",
    {HAND: ["cube_50", "ball_60", "flat_box"]},
    [20.0, 50.0],
    ["dynamic_reach", "reactive"],
    range(4),
)


def test_draws_are_those_of_the_seed_and_begin_alike():
    first = drawn_objects("primitives", HAND, 4, 1, range(10))
    assert first == drawn_objects("primitives", HAND, 10, 1, range(10))[:4]
    assert first != drawn_objects("primitives", HAND, 4, 2, range(10))
    assert len(set(first)) == 4
    pool = list(object_sets.SETS["primitives"]())[3:5]
    assert sorted(drawn_objects("primitives", HAND, 10, 1, range(3, 5))) == sorted(pool)


def test_objects_fit_if_some_width_is_in_the_opening_and_a_tip_reaches_under_their_top():
    limits = (0.02, 0.08)
    assert fits(Box([0.2, 0.05, 0.05]).make_shape(), limits)
    assert not fits(Box([0.2, 0.09, 0.05]).make_shape(), limits)
    assert not fits(Cylinder(0.005, 0.1).make_shape(), limits)
    assert not fits(Box([0.2, 0.05, 0.012]).make_shape(), limits)
    # Two fingertips of the shipped hand have held boxes of 206 mm.
    least, largest = opening(made_hand(load_hand(object_sets.hand_file(HAND))))
    assert least == pytest.approx(0.018)
    assert 0.206 < largest < 0.4


def test_a_missing_extra_is_named_and_not_taken_for_objects_that_do_not_fit(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InvalidArgumentError, match="pip install"):
        drawn_objects("random", HAND, 1, 0, range(997, 1000))


@pytest.mark.slow
def test_a_trial_has_the_objects_own_yaw_of_the_seed():
    jobs = [ObjectJob("primitives", name, HAND, 20.0, "reactive", 3) for name in ("cube_50",) * 2]
    jobs += [jobs[0]._replace(seed=4), jobs[0]._replace(object="tall_box")]
    yaws = [make_scenario(job).scenario.motion.yaw for job in jobs]
    assert yaws[0] == yaws[1]
    assert len(set(yaws)) == 3
    motion = make_scenario(jobs[0]._replace(speed=40.0)).scenario.motion
    assert motion.linear_velocity == pytest.approx(0.04)
    assert motion.angular_velocity == pytest.approx(np.radians(20))


@pytest.mark.slow
def test_an_object_without_a_grasp_is_refused_with_what_is_missing(monkeypatch):
    def odd_objects():
        return {"slab": Box([0.25, 0.25, 0.012], 0.1), "heavy": Box([0.06, 0.06, 0.06], 20.0)}

    monkeypatch.setitem(object_sets.SETS, "odd", odd_objects)
    for name, cause, why in (("slab", "refused: room", "fingertips"), ("heavy", "refused", "N")):
        row = run_trial(ObjectJob("odd", name, HAND, 20.0, "dynamic_reach", 0))
        assert (row["held"], row["cause"]) == (False, cause)
        assert why in row["gave_up"]


@pytest.mark.slow
def test_a_palm_comes_from_the_side_if_there_is_no_grasp_from_above(monkeypatch):
    objects = {"tall": Cylinder(0.03, 0.32, 0.4), "box": Box([0.06, 0.06, 0.08], 0.2)}
    monkeypatch.setitem(object_sets.SETS, "odd", lambda: objects)
    # Fingers from above reach 0.15 m below the top.
    lower = "no_touch: [!BehindPlane {point: [0.0, 0.0, 0.0], normal: [0.0, 0.0, -1.0]}]"
    text = f"surface: {{spacing: 0.02, forbidden_faces: [], {lower}}}"
    for name, approaches in (("tall", ["side"]), ("box", ["above"])):
        job = ObjectJob("odd", name, HAND, 20.0, "dynamic_reach", 3, text)
        assert make_scenario(job).scenario.grasp.approaches == approaches


@pytest.mark.slow
def test_a_study_is_resumed_and_its_tables_count_every_trial(tmp_path, monkeypatch):
    monkeypatch.setattr(objects_command, "pictures_of_grasps", lambda *arguments: [])
    study_objects(tmp_path, JOBS[:20], run=made_up_trial, processes=1)
    found, report = study_objects(tmp_path, JOBS, run=made_up_trial, processes=1)
    again, _ = study_objects(tmp_path, JOBS, run=made_up_trial, processes=1)
    assert (found.made, len(again.rows)) == (len(JOBS), len(JOBS))
    pd.testing.assert_frame_equal(found.rows, again.rows)
    rows = pd.DataFrame([job._asdict() | made_up_trial(job) for job in JOBS])
    counts = cause_table(found.rows).data
    assert counts.iloc[:, 3:].to_numpy().sum() == len(JOBS)
    shares = share_table(found.rows).data
    held = rows.groupby(["speed", "method"])["held"].sum().to_list()
    assert sorted(int(text.split()[0]) for text in shares["held"]) == sorted(held)
    text = report.read_text(encoding="utf-8")
    for cause in CAUSES[1:]:
        assert cause in text


def test_the_household_set_has_the_shipped_meshes():
    shapes = object_sets.SETS["household"]()
    assert len(shapes) == 12
    assert all(isinstance(config, Mesh) for config in shapes.values())
    assert all(config.make_shape().mesh.volume > 0 for config in shapes.values())


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--hands", "claw"], "no such hand"),
        (["--methods", "luck"], "no such method"),
        (["--pool", "all"], "invalid range of indices"),
        (["--speeds", "fast"], "invalid list of speeds"),
    ],
)
def test_unusable_options_end_with_one_line(options, problem, capsys, tmp_path):
    arguments = ["study", "objects", "--set", "primitives", "--out", str(tmp_path), *options]
    with contextlib.suppress(SystemExit):  # Of the parser of options.
        assert main(arguments) == 2
    error = capsys.readouterr().err
    assert problem in error
    assert error.count("\n") == 1


@pytest.mark.slow
def test_an_object_from_the_command_to_the_pictures(tmp_path):
    text, alone = "{grasp: {close_at: 3.5}}", ["--out", str(tmp_path), "--processes", "1"]
    options = ["--set", "primitives", "--pool", "1-1", "--methods", "dynamic_reach,reactive"]
    assert main(["study", "objects", *options, "--scenario_text", text, *alone]) == 0
    rows = pd.read_csv(tmp_path / "objects" / "rows.csv")
    assert set(rows["text"]) == {text}
    settings = json.loads((tmp_path / "objects" / "settings.json").read_text())
    assert settings["study"]["scenario"]["grasp"]["close_at"] == 3.5
    assert len(rows) == 2
    assert rows[rows["method"] == "dynamic_reach"]["held"].all()
    assert rows["cause"].isna().eq(rows["held"]).all()
    assert rows["pushed_before_squeeze_mm"].max() < 2
    assert (tmp_path / "objects" / "pictures.png").stat().st_size > 10_000
