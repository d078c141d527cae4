"""The report and the command of the comparison of methods."""

import functools
import html
import re

import numpy as np
import pandas as pd
import pytest
from conftest import slow
from drake_pregrasp.studies.static_versus_dynamic import comparison_command, comparison_report
from drake_pregrasp.studies.static_versus_dynamic.comparison_command import trial_jobs
from drake_pregrasp.studies.static_versus_dynamic.comparison_report import write_comparison
from drake_pregrasp.studies.static_versus_dynamic.conditions import CONDITIONS
from drake_pregrasp.studies.static_versus_dynamic.grasp_outcome import TOUCHING_N
from drake_pregrasp.studies.static_versus_dynamic.methods import METHODS
from drake_pregrasp.studies.static_versus_dynamic.paired_statistics import paired_tests
from made_up_trials import failing_trial, rows_of
from PIL import Image

from drake_pregrasp import OutputError
from drake_pregrasp.cli import main
from drake_pregrasp.studies.report_page import Picture

ROWS = rows_of(trial_jobs(CONDITIONS, METHODS, range(4)))


def rows_with(condition, clean_seeds, seeds=20, times=None, **columns):
    """Rows in which each method is clean, and lifts, with the first so many seeds."""
    rows = rows_of(trial_jobs([condition], list(clean_seeds), range(seeds)))
    rows["clean"] = rows["lifted"] = rows["seed"] < rows["method"].map(clean_seeds)
    rows = rows.assign(**columns)
    return rows[rows["close_at"].isin(times or CONDITIONS[condition].closing_times)]


@pytest.mark.parametrize(
    ("tested", "baseline", "cell"),
    [(19, 4, "ahead at {}"), slow(4, 19, "behind at {}"), slow(10, 10, "not shown (least p 1)")],
)
def test_verdicts_follow_the_rows_whoever_leads(tested, baseline, cell):
    rows = rows_with("nominal", {"fixed_plan": baseline, "dynamic_reach": tested})
    few_at_7 = rows[(rows["close_at"] == 4) | (rows["seed"] < 3)]
    for some, times in ((rows, "4, 7 s"), (few_at_7, "4 s")):
        (line,) = comparison_report.overview_table(paired_tests(some)).data.data.to_dict("records")
        assert line == {"dynamic with reach against": "nominal", "fixed plan": cell.format(times)}


def test_every_count_and_test_is_in_the_tables():
    tests = paired_tests(ROWS)
    for condition, own in ROWS.groupby("condition"):
        table = comparison_report.outcome_table(own).data
        for success in ("clean", "lifted"):
            counts = own.groupby(["method", "close_at"])[success].sum()
            shown = [counts[method, time] for method in METHODS for time in counts[method].index]
            assert table[success].str.split(" ").str[0].astype(int).tolist() == shown
        of_condition = tests[tests["condition"] == condition]
        shown = comparison_report.paired_test_table(of_condition).data.data
        assert sorted(shown["only it clean"]) == sorted(of_condition["gained"])
        assert sorted(shown["only the other clean"]) == sorted(of_condition["lost"])
        # Bounds of the difference are rounded outward.
        columns = ("difference, least", "most")
        least, most = (shown[column].str.rstrip(" %").astype(float) for column in columns)
        exact = of_condition.sort_values(
            "method", key=lambda keys: keys.map(list(METHODS).index), kind="stable"
        )
        assert np.all(least.to_numpy() <= 100 * exact["low"].to_numpy())
        assert np.all(most.to_numpy() >= 100 * exact["high"].to_numpy())


def test_clean_and_other_lifted_objects_are_counted_for_each_closing_time():
    rows = rows_with("wall", {"fixed_plan": 0, "dynamic_reach": 3}, seeds=4, times=[3.0, 9.0])
    rows.loc[(rows["seed"] == 3) & (rows["close_at"] == 9), "lifted"] = True
    first, last = comparison_report.results_table(rows).data.to_dict("records")
    head = {"condition": "wall", "closes at [s]": 3.0, "seeds": 4}
    assert first == {**head, "fixed plan": "0", "dynamic with reach": "3"}
    head["closes at [s]"] = 9.0
    assert last == {**head, "fixed plan": "0 (+1)", "dynamic with reach": "3 (+1)"}


def test_grasps_are_counted_in_which_links_touched_something():
    rows = rows_with("wall", {"fixed_plan": 4}, seeds=4, times=[3.0], link_on_object_n=0.0)
    rows["link_on_hand_n"] = 0.0
    rows["link_on_surroundings_n"] = [0.0, TOUCHING_N - 0.01, TOUCHING_N, 0.0]
    rows.loc[rows.index[-1], "link_on_object_n"] = 2.0
    table = comparison_report.outcome_table(rows).data
    assert table["links touched"].str.startswith("2 of 4").all()


def test_reasons_are_counted_by_their_kind():
    rows = rows_with("wall", {"fixed_plan": 0}, seeds=4, times=[3.0])
    rows["gave_up"] = [
        "finger 0 met nothing",
        "finger 3 met nothing",
        "",
        "no squeeze balances the weight: 1.25 N are left for lack of friction",
    ]
    table = comparison_report.reason_table(rows).data
    assert dict(zip(table["reason"], table["grasps"], strict=True)) == {
        "a finger met nothing": 2,
        "no squeeze balances the weight for lack of friction": 1,
    }


def text_of(page):
    """Returns a page without the data of its figures."""
    return re.sub(r"(?<=base64,)[^\"]+", "", page.read_text())


@pytest.mark.slow
def test_the_page_is_self_contained_and_all_text_is_escaped(tmp_path):
    Image.new("RGB", (4, 3), "red").save(tmp_path / "red.png")
    figures = [Picture(tmp_path / "red.png", 'It is "red" & <small>.')]
    failed = pd.DataFrame([{"method": "stationary", "error": "ValueError: <b> & co"}])
    page = text_of(write_comparison(tmp_path, ROWS, failed, {"k": "</pre>"}, figures))
    assert page.count("data:image/png;base64,") == 2
    assert not re.search(r"(src|href)\s*=\s*['\"](?!data:)", page)
    for text in ("<small>.", "<b> & co", "met <nothing> & stopped"):
        assert html.escape(text) in page
    for text in ("<small>.", "<b>", "<nothing>", '"</pre>'):
        assert text not in page


@pytest.mark.slow
def test_a_study_without_rows_has_a_page_and_one_without_its_picture_has_none(tmp_path):
    none = pd.DataFrame()
    assert "There are no grasps yet." in text_of(write_comparison(tmp_path, none, none, {}))
    with pytest.raises(OutputError, match=r"none.png: cannot be read back"):
        write_comparison(tmp_path, ROWS, none, {}, [Picture(tmp_path / "none.png", "x")])


@pytest.mark.slow
def test_the_command_says_what_failed_and_reports_all_that_is_there(tmp_path, capsys, monkeypatch):
    compare = functools.partial(comparison_command.compare_methods, run=failing_trial)
    monkeypatch.setattr(comparison_command, "compare_methods", compare)
    command = ["study", "static-versus-dynamic", "--out", str(tmp_path), "--processes", "1"]
    command += ["--methods", "fixed_plan,dynamic_reach", "--conditions"]
    folder = tmp_path / "static-versus-dynamic"
    assert main([*command, "nominal, wall", "--seeds", "2"]) == 1
    captured = capsys.readouterr()
    assert captured.out.startswith("6 of 8 trials are complete\n")
    assert f"report in {folder / 'report.html'}" in captured.out
    assert f"2 trials failed: see {folder / 'failed.csv'}" in captured.err
    assert main([*command, "wall", "--seeds", "1", "--first_seed", "5"]) == 1
    assert capsys.readouterr().out.startswith("2 of 2 trials are complete\n")
    page = text_of(folder / "report.html")
    assert "2 trials failed" in page
    assert "8 trials, 21 grasps" in page


def test_methods_are_in_the_order_of_tables_and_unknown_ones_are_refused(capsys):
    jobs = trial_jobs(["wall"], ["dynamic", "fixed_plan"], [0])
    assert [job.method for job in jobs] == ["fixed_plan", "dynamic"]
    assert main(["study", "static-versus-dynamic", "--methods", "luck"]) == 2
    assert "luck: no such method" in capsys.readouterr().err
