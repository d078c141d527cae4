"""Verdicts go both ways: each judge is given logs of either kind."""

from types import SimpleNamespace

import numpy as np
import pytest

from drake_pregrasp import load_scenario
from drake_pregrasp.studies import claims, discretisation


def log(q_gii=0.99, q_msv=2.2, q_vew=125.0, static=0.9, moved=0.001, p_OC=None, size=0.1):
    """A log of 200 ticks, 80 of them static, with a measure that may be an array over the rest."""
    time = 0.05 * np.arange(200)
    columns = {}
    for name, value in (("q_msv", q_msv), ("q_gii", q_gii), ("q_vew", q_vew)):
        columns[name] = np.concatenate([np.full(80, static * np.mean(value)), value * np.ones(120)])
    columns["displacement"] = np.full(200, moved)
    scenario = load_scenario("a_base")
    scenario.object.size = [size] * 3
    return SimpleNamespace(
        time=time,
        columns=columns,
        scenario=scenario,
        static=slice(0, 80),
        last_phase=slice(80, None),
        settled=slice(110, None),
        p_OC=lambda tick: np.array(p_OC),
    )


AROUND = 0.05 * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 1, 0.3]])
AT_EDGES = AROUND + 0.048 * np.array([[0, 1, 0], [0, 1, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0.0]])


@pytest.mark.parametrize(("static", "holds"), [(0.9, True), (1.1, False)])
def test_dynamic_beats_static(static, holds):
    claim = claims.dynamic_beats_static({"a": [log(static=static)]})
    assert claim.holds == holds
    assert bool(claim.remark) != holds


def test_settled_values_below_static_are_named():
    transient = np.append([1.0], np.full(119, 0.9))
    claim = claims.dynamic_beats_static({"h": [log(q_gii=transient, static=1.05)]})
    assert "Q_GII is lower in h (settled values)" in claim.remark


@pytest.mark.parametrize(("q_vew", "holds"), [(125.0, True), (120.0, False)])
def test_poor_start_recovers(q_vew, holds):
    assert claims.poor_start_recovers({"a": [log()], "g": [log(q_vew=q_vew)]}).holds == holds


@pytest.mark.parametrize(("q_gii", "holds"), [(0.99, True), (0.97, False)])
def test_strategies_are_alike(q_gii, holds):
    logs = {"a": [log()], "h": [log()], "i": [log()], "j": [log(q_gii=q_gii)]}
    assert claims.strategies_are_alike(logs).holds == holds


@pytest.mark.parametrize(("moved", "holds"), [((4, 3, 2, 1), True), ((3, 4, 2, 1), False)])
def test_activity_ranks(moved, holds):
    logs = {case: [log(moved=m)] for case, m in zip("ihja", moved, strict=True)}
    claim = claims.activity_ranks(logs)
    assert claim.holds == holds
    assert claim.numbers["in_order"]["gii > msv"] == f"{int(holds)} of 1 seeds"


@pytest.mark.parametrize(("p_OC", "holds"), [(AROUND, True), (np.abs(AROUND), False)])
def test_position_surrounds(p_OC, holds):
    assert claims.position_surrounds({"a": [log(p_OC=p_OC)]}).holds == holds


@pytest.mark.parametrize(("vew", "holds"), [(AT_EDGES, True), (AROUND, False)])
def test_volume_goes_outwards(vew, holds):
    logs = {"a": [log(p_OC=AROUND)], "j": [log(p_OC=vew)]}
    assert claims.volume_goes_outwards(logs).holds == holds


@pytest.mark.parametrize(("faster", "holds"), [(0.995, True), (0.9901, False), (0.98, False)])
def test_faster_is_more_isotropic(faster, holds):
    logs = {"b": [log(q_gii=0.99), log(q_gii=0.9905)], "c": [log(q_gii=faster)]}
    assert claims.faster_is_more_isotropic(logs).holds == holds


@pytest.mark.parametrize(("bigger", "holds"), [((0.95, 126.0), True), ((0.995, 126.0), False)])
def test_size_matters(bigger, holds):
    q_gii, q_vew = bigger
    assert claims.size_matters({"d": [log()], "e": [log(q_gii=q_gii, q_vew=q_vew)]}).holds == holds


@pytest.mark.parametrize(("position", "holds"), [(1.0, True), (9.0, False)])
def test_position_is_fastest(position, holds):
    tick_ms = {"a": position, "h": 3.0, "i": 3.0, "j": 2.0}
    assert claims.position_is_fastest(tick_ms).holds == holds


@pytest.mark.parametrize(("fine", "holds"), [(0.1, True), (0.3, False)])
def test_spacing_costs_quality(fine, holds):
    costs = {0.01: np.array([0.4]), 0.005: np.array([0.2]), 0.0025: np.array([fine])}
    assert discretisation.spacing_costs_quality(costs).holds == holds


@pytest.mark.parametrize(("fine", "holds"), [(0.001, True), (0.02, False)])
def test_drops_come_from_spacing(fine, holds):
    ripple = np.tile([1.0, 0.0], 60)
    logs = {
        spacing: log(q_gii=0.9 + drop * ripple)
        for spacing, drop in ((0.01, 0.01), (0.005, 0.005), (0.0025, fine))
    }
    assert discretisation.drops_come_from_spacing(logs).holds == holds
