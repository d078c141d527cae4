"""The report of a study says what the rows say, whichever arm they favour."""

import dataclasses
import html
import itertools
import math
import re
import signal

import numpy as np
import pytest
from made_up_trials import at_once, failing_trial, made_up_trial
from matplotlib.colors import to_rgb
from matplotlib.image import imread
from PIL import Image

from drake_pregrasp import InvalidArgumentError, OutputError
from drake_pregrasp.cli import main
from drake_pregrasp.cli.command import OneLineParser
from drake_pregrasp.studies.markup import Cell, table
from drake_pregrasp.studies.static_versus_dynamic import trials
from drake_pregrasp.studies.static_versus_dynamic.arms import ARMS
from drake_pregrasp.studies.static_versus_dynamic.command import add_command
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.experiment import Experiment, ReportFigure
from drake_pregrasp.studies.static_versus_dynamic.goals import Goal, judge_goals
from drake_pregrasp.studies.static_versus_dynamic.no_worse import no_worse_in_words
from drake_pregrasp.studies.static_versus_dynamic.outcome import Outcome, TrialJob
from drake_pregrasp.studies.static_versus_dynamic.outcome_table import surrenders
from drake_pregrasp.studies.static_versus_dynamic.paired_difference import paired_difference
from drake_pregrasp.studies.static_versus_dynamic.paired_test import SIGNIFICANT
from drake_pregrasp.studies.static_versus_dynamic.picture_grid import plot_picture_grid
from drake_pregrasp.studies.static_versus_dynamic.report import write_report
from drake_pregrasp.studies.static_versus_dynamic.results import Results
from drake_pregrasp.studies.static_versus_dynamic.strip_charts import Strip, plot_strips
from drake_pregrasp.studies.static_versus_dynamic.study import trial_jobs
from drake_pregrasp.studies.static_versus_dynamic.verdicts import judge
from drake_pregrasp.studies.static_versus_dynamic.words import (
    comparisons_in_words,
    condition_in_words,
    overview,
)

ROWS = [o for job in trial_jobs(CONDITIONS, ARMS, range(8)) for o in made_up_trial(job)]


def row(condition, arm, seed, close_at, clean) -> Outcome:
    (some, *_) = made_up_trial(TrialJob(condition, "still", 0))
    good = dataclasses.replace(
        some,
        pushed_before_mm=0.0,
        turned_before_deg=0.0,
        pushed_closing_mm=0.0,
        slip_mm=0.1,
        goal_in_area=math.nan,
    )
    key = {"condition": condition, "arm": arm, "seed": seed, "close_at": close_at}
    return dataclasses.replace(good, lifted=clean, level=clean, **key)


def rows_of(condition, clean_seeds, seeds=20, times=(4.0,)):
    """Rows in which each arm is clean with the first so many seeds."""
    return [
        row(condition, arm, seed, time, seed < clean)
        for arm, clean in clean_seeds.items()
        for seed in range(seeds)
        for time in times
    ]


def words_of(rows):
    results = Results(rows)
    verdicts = judge(results)
    num_tests = sum(len(of_arm) for v in verdicts for of_arm in v.against.values())
    text = [*overview(verdicts), *condition_in_words(results, verdicts[0], num_tests)]
    return "\n".join(text).replace("\u00a0", " ")


def test_words_follow_the_rows_whoever_leads():
    helps = words_of(rows_of("nominal", {"frozen": 4, "dynamic_reach": 19}))
    assert (
        "more often than every other arm, at one closing time at least, under: nominal (at every"
        in helps
    )
    assert "Under no condition is it shown to be clean less often" in helps
    assert "Largest count of clean grasps, closing at 4 s: dynamic with reach 19 of 20" in helps
    assert "is ahead of (clean more often than) frozen plan (at 1 of 1 closing times: 4" in helps
    rows = rows_of("nominal", {"frozen": 4, "dynamic_reach": 19})
    rows += rows_of("nominal", {"frozen": 4, "dynamic_reach": 4}, times=(8.0,))
    assert "at one closing time at least, under: nominal." in words_of(rows)
    assert "frozen plan (at 1 of 2 closing times: 4 s, p < 0.001)." in words_of(rows)
    hurts = words_of(rows_of("nominal", {"frozen": 19, "dynamic_reach": 4}))
    assert "not shown to be clean more often than any other arm under: nominal." in hurts
    assert "clean less often than another arm, at one closing time at least, under: nom" in hurts
    assert "is behind (clean less often than) frozen plan (at 1 of 1 closing times: 4 s" in hurts
    equal = words_of(rows_of("nominal", {"frozen": 10, "dynamic_reach": 10}))
    assert "not shown to be clean more often than any other arm under: nominal." in equal
    assert "not shown to differ, at any closing time, from frozen plan (least p = 1)." in equal
    some = words_of(rows_of("nominal", {"frozen": 4, "still": 20, "dynamic_reach": 19}))
    assert "than some arms and not all, or only at some times, under: nominal (not than still" in (
        some
    )


def test_words_on_little_are_modest():
    assert "With 5 common seeds no difference can be shown: 6 are the fewest" in words_of(
        rows_of("wall", {"frozen": 0, "dynamic_reach": 5}, seeds=5)
    )
    assert "No grasp is clean." in words_of(rows_of("wall", {"frozen": 0, "dynamic_reach": 0}))
    alone = words_of(rows_of("wall", {"frozen": 3}))
    assert "Dynamic with reach was not compared with another arm." in alone


def test_only_common_seeds_are_compared():
    rows = rows_of("wall", {"frozen": 0, "dynamic_reach": 20})
    kept = [r for r in rows if r.arm != "frozen" or r.seed % 2]
    assert Results(kept).test("wall", "dynamic_reach", "frozen", 4.0)[:3] == (10, 10, 0)


def test_exchanged_arms_exchange_what_is_said():
    names = {"frozen": "dynamic_reach", "dynamic_reach": "frozen"}
    rows = [o for job in trial_jobs(CONDITIONS, names, range(20)) for o in made_up_trial(job)]
    swapped = [dataclasses.replace(r, arm=names[r.arm]) for r in rows]
    before, after = judge(Results(rows)), judge(Results(swapped))
    assert any(verdict.ahead for verdict in before)
    for one, other in zip(before, after, strict=True):
        assert [*one.ahead.get("frozen", {})] == [*other.behind.get("frozen", {})]
        assert [*one.behind.get("frozen", {})] == [*other.ahead.get("frozen", {})]
        assert one.open.keys() == other.open.keys()


def test_only_tests_of_the_tested_arm_are_made_and_what_others_do_to_each_other_is_not_said():
    rivals = [arm for arm in ARMS if arm != "dynamic_reach"]
    for verdict in judge(Results(ROWS)):
        assert list(verdict.against) == rivals
        for of_arm in verdict.against.values():
            assert list(of_arm) == list(CONDITIONS[verdict.condition].closing_times)
    rows = rows_of("wall", {"frozen": 0, "still": 20})
    assert [verdict.against for verdict in judge(Results(rows))] == [{}]


def test_what_is_said_is_corrected_for_all_that_is_tested():
    clean = {"frozen": 4, "dynamic_reach": 10}
    alone = rows_of("nominal", clean)
    assert judge(Results(alone))[0].ahead
    # Other conditions add tests, which show nothing, and the same rows no longer do.
    more = alone + rows_of("wall", {"frozen": 9, "dynamic_reach": 9})
    verdict = judge(Results(more))[0]
    assert verdict.against["frozen"][4.0].test.p < SIGNIFICANT
    assert (verdict.ahead, verdict.behind) == ({}, {})
    assert "not shown to differ" in words_of(more)


def test_many_comparisons_are_counted():
    rows = rows_of("wall", {"frozen": 0, "still": 12, "dynamic_reach": 18})
    rows += rows_of("nominal", {"frozen": 20, "dynamic_reach": 0})
    words = comparisons_in_words(judge(Results(rows))).replace("\u00a0", " ")
    assert "rest on the 3 tests of dynamic with reach" in words
    assert "3 would have p < 0.05 by themselves; 3 have" in words
    rows += rows_of("sphere", {"frozen": 3, "dynamic_reach": 3})
    words = comparisons_in_words(judge(Results(rows))).replace("\u00a0", " ")
    assert "3 would have p < 0.05 by themselves; 2 have" in words


@pytest.mark.parametrize(("frozen", "tested"), [(20, 20), (20, 12), (12, 20), (0, 20)])
def test_no_worse_is_the_lower_end_of_the_interval_rounded_outward(frozen, tested):
    rows = rows_of("nominal", {"frozen": frozen, "dynamic_reach": tested}, times=(4.0, 7.0))
    words = no_worse_in_words(Results(rows))
    assert len(words) == 2
    low, high = paired_difference(Results(rows).test("nominal", "dynamic_reach", "frozen", 4.0))
    said = float(re.search(r"by more than (\S+) clean grasps of 20,", words[0]).group(1))
    assert max(0, -20 * low) <= said <= max(0, -20 * low) + 0.1
    ends = re.search(r"shares (\S+) % to (\S+) %", words[0]).groups()
    assert float(ends[0]) <= 100 * low
    assert float(ends[1]) >= 100 * high
    np.testing.assert_allclose(np.array(ends, dtype=float), [100 * low, 100 * high], atol=0.1)


def test_no_worse_is_said_of_common_seeds_alone():
    assert no_worse_in_words(Results(rows_of("wall", {"frozen": 1, "dynamic_reach": 1}))) == []
    assert no_worse_in_words(Results(rows_of("nominal", {"frozen": 1}))) == []
    rows = rows_of("nominal", {"frozen": 20, "dynamic_reach": 20})
    apart = [r for r in rows if (r.arm == "frozen") == bool(r.seed % 2)]
    assert no_worse_in_words(Results(apart)) == []


@pytest.mark.parametrize(("clean", "reached"), [(25, True), (24, False)])
def test_goals_are_bounds_at_each_time(clean, reached):
    rows = rows_of("headline", {"still": clean}, seeds=30, times=(4.0, 8.0))
    rows += rows_of("headline", {"still": 30}, seeds=30, times=(12.0,))
    goal = Goal("headline", "still", "clean", 25)
    result = judge_goals(Results(rows), [goal])[0]
    assert result.reached is reached
    assert result.found.startswith(f"{clean} of 30 at 4 s, {clean} of 30 at 8 s")
    assert judge_goals(Results(rows[:-30]), [goal])[0].reached is None


def test_goals_are_shares_with_another_number_of_seeds():
    goal = Goal("headline", "still", "clean", 25, (4.0,))
    for clean, reached in ((5, True), (4, False)):
        rows = rows_of("headline", {"still": clean}, seeds=6)
        assert judge_goals(Results(rows), [goal])[0].reached is reached


@pytest.mark.parametrize(("share", "reached"), [(0.0, True), (0.01, False), (math.nan, None)])
def test_no_goal_may_be_in_the_area_at_any_tick(share, reached):
    rows = [
        dataclasses.replace(r, goal_in_area=share if r.seed == 1 else 0.0)
        for r in rows_of("wall", {"dynamic_reach": 2}, seeds=3)
    ]
    assert judge_goals(Results(rows), [])[0].reached is reached


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    Image.new("RGB", (4, 3), "red").save(folder / "red.png")
    figures = [ReportFigure("A <look>", folder / "red.png", 'It is "red" & <small>.')]
    failures = {TrialJob("wall", "still", 3): "ValueError: <b> & co"}
    write_report(folder / "report.html", ROWS, {"k": "</pre>"}, failures=failures, figures=figures)
    return (folder / "report.html").read_text()


def test_the_page_is_self_contained_and_all_text_is_escaped(page):
    assert page.count("data:image/png;base64,") == 2
    assert not re.search(r"(src|href)\s*=\s*['\"](?!data:)", page)
    for text in (ROWS[0].gave_up or "<after", "A <look>", "<small>.", "<b> & co", '"</pre>"'):
        assert html.escape(text) in page
    for text in ("<after", "<look>", "<small>.", "<b>", '"</pre>'):
        assert text not in page
    for tag in ("table", "td", "ul", "div"):
        assert page.count(f"<{tag}") == page.count(f"</{tag}>"), tag


def test_every_count_and_test_is_on_the_page(page):
    results = Results(ROWS)
    for condition in results.conditions:
        part = page.split(f'id="{condition}"')[1].split("<h2")[0]
        for arm in results.arms(condition):
            for time in results.times(condition):
                for success in ("clean", "lifted"):
                    assert f">{results.count(condition, arm, time, success)} of 8<" in part
        (verdict,) = (v for v in judge(results) if v.condition == condition)
        for of_arm in verdict.against.values():
            for test, _ in of_arm.values():
                assert f"+{test.gained} −{test.lost} of 8" in part


def test_the_same_rows_give_the_same_page_in_any_order(tmp_path):
    seeds = [o.seed for o in Results(ROWS[::-1]).cell("wall", "still", 6.0)]
    assert seeds == list(range(8))
    some = [o for o in ROWS if o.condition in ("nominal", "wall")]
    for name, rows in (("a", some), ("b", some[::-1])):
        write_report(tmp_path / name, rows, {}, failures={})
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_a_study_without_outcomes_has_a_page(tmp_path):
    write_report(tmp_path / "report.html", [], {}, failures={})
    assert "There are no outcomes yet." in (tmp_path / "report.html").read_text()
    figure = ReportFigure("x", tmp_path / "none.png", "x")
    with pytest.raises(OutputError, match=r"none.png: can't be read back"):
        write_report(tmp_path / "report.html", [], {}, failures={}, figures=[figure])


def test_tables_have_a_cell_for_each_head():
    text = table([Cell("a"), Cell("b", "c<")], [[Cell("1", share=0.5), Cell("2", kind="x")]], "d")
    assert text.count("<th") - text.count("<thead") == text.count("<td") == 2
    assert "--share:50.0%" in text
    assert "<small>c&lt;</small>" in text


def test_strips_are_of_one_length_and_drawn(tmp_path):
    time = np.linspace(0, 5, 11)
    nothing = np.full(11, np.nan)
    strips = [
        Strip("still", time, np.full(11, 5.0), nothing, [(1.0, True)]),
        Strip("frozen", time, np.full(11, 3.0), np.linspace(-9, 20, 11), []),
    ]
    plot_strips(tmp_path / "two.png", strips, num_fingers=5)
    plot_strips(tmp_path / "one.png", strips[:1], num_fingers=5)
    one, two = (imread(tmp_path / f"{name}.png") for name in ("one", "two"))
    assert len(two) > 1.5 * len(one)
    assert np.any(np.all(np.abs(two[..., :3] - to_rgb(ARMS["frozen"].color)) < 0.01, axis=2))
    with pytest.raises(InvalidArgumentError, match=r"strip still: .* not 10, 11, 11"):
        plot_strips(tmp_path / "x.png", [strips[0]._replace(time=time[1:])], num_fingers=5)
    with pytest.raises(InvalidArgumentError, match="there must be one at least"):
        plot_strips(tmp_path / "x.png", [], num_fingers=5)


def test_pictures_keep_their_places_in_the_grid(tmp_path):
    colors = [["red", "lime", "black"], ["blue", "yellow", "cyan"]]
    files = [[tmp_path / f"{color}.png" for color in of_row] for of_row in colors]
    for file in itertools.chain(*files):
        Image.new("RGB", (40, 30), file.stem).save(file)
    labels = {"rows": ["a $", "b"], "columns": ["1 s", "2 s", "3 s"]}
    captions = [["x", "y", "z"], ["x", "$", "z"]]
    plot_picture_grid(tmp_path / "grid.png", files, captions=captions, **labels)
    grid = imread(tmp_path / "grid.png")
    height, width, _ = grid.shape
    for y, of_row in zip((0.25, 0.75), colors, strict=True):
        for x, color in zip((0.2, 0.5, 0.85), of_row, strict=True):
            pixel = grid[int(y * height), int(x * width), :3]
            np.testing.assert_allclose(pixel, to_rgb(color), atol=0.01)
    with pytest.raises(InvalidArgumentError, match=r"pictures: 2 rows of 3 .* not rows of \[3\]"):
        plot_picture_grid(tmp_path / "x.png", files[:1], **labels)
    with pytest.raises(InvalidArgumentError, match=r"captions: 2 rows of 3 .* \[3, 1\]"):
        plot_picture_grid(tmp_path / "x.png", files, captions=[captions[0], ["z"]], **labels)
    files[0][0].unlink()
    with pytest.raises(OutputError, match=r"red.png: can't be read back"):
        plot_picture_grid(tmp_path / "x.png", files, **labels)


def run_command(arguments, trial):
    def load():
        return Experiment(trial, {})

    parser = OneLineParser()
    add_command(parser.add_subparsers(), load)
    options = parser.parse_args(["static-versus-dynamic", *map(str, arguments)])
    return options.command(options)


def test_the_command_runs_reports_and_says_what_failed(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(trials, "as_they_end", at_once)
    few = ["--out", tmp_path, "--conditions", "nominal, wall", "--arms", "frozen,dynamic_reach"]
    folder = tmp_path / "static-versus-dynamic"
    assert run_command([*few, "--seeds", 2, "--first_seed", 5], made_up_trial) == 0
    captured = capsys.readouterr()
    assert captured.out.startswith("8 of 8 trials are there\n")
    assert f"report in {folder / 'report.html'}" in captured.out
    assert captured.err == ""
    assert run_command([*few, "--seeds", 1, "--processes", 1], failing_trial) == 1
    captured = capsys.readouterr()
    assert captured.out.startswith("2 of 4 trials are there\n")
    assert f"2 trials failed: {folder / 'failed.csv'} says why" in captured.err
    # Of both arms two seeds, and one more of the arm and conditions that don't fail.
    times = {name: len(CONDITIONS[name].closing_times) for name in ("nominal", "wall")}
    grasps = 2 * 2 * sum(times.values()) + sum(times.values())
    assert f"10 trials, {grasps} grasps" in (folder / "report.html").read_text()


def test_a_request_to_end_is_an_interruption(tmp_path, capsys):
    def load():
        signal.raise_signal(signal.SIGTERM)

    parser = OneLineParser()
    add_command(parser.add_subparsers(), load)
    options = parser.parse_args(["static-versus-dynamic", "--out", str(tmp_path)])
    before = signal.getsignal(signal.SIGTERM)
    assert options.command(options) == 130
    assert signal.getsignal(signal.SIGTERM) == before
    assert "the same command goes on from there" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--arms", "still,luck"], "luck: no such arm; there are: world,carried"),
        (["--conditions", ""], ": no such condition; there are: nominal,one_lost"),
        (["--seeds", "0"], "--seeds: 0 must be 1 or more"),
        (["--first_seed", "-1"], "--first_seed: -1 must be 0 or more"),
        (["--processes", "0"], "--processes: 0 must be 1 or more"),
    ],
)
def test_bad_options_are_one_line_and_status_2(arguments, problem, capsys):
    assert main(["study", "static-versus-dynamic", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert problem in captured.err
    assert captured.err.count("\n") == 1


def test_reasons_are_counted_by_their_kind():
    rows = rows_of("wall", {"frozen": 0}, seeds=4, times=(3.0,))
    reasons = ["finger 0 met nothing", "finger 3 met nothing", "only 2 active fingers"]
    reasons.append("no squeeze balances the weight: 1.25 N are left")
    rows = [dataclasses.replace(r, gave_up=why) for r, why in zip(rows, reasons, strict=True)]
    (said,) = surrenders(Results(rows), "wall")
    assert "a finger met nothing (2); only 2 active fingers (1)" in said
    assert said.endswith("no squeeze balances the weight (1)")
