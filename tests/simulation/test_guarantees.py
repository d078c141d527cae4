"""Every shipped scenario keeps, tick by tick, what its limits promise."""

import numpy as np
import pytest

from drake_pregrasp import load_scenario, resolve, run, shipped_scenarios
from drake_pregrasp.contacts.goal_limits import tip_gaps
from drake_pregrasp.contacts.selection_input import ContactStatus, is_active
from drake_pregrasp.simulation.obstacle_config import moving_solid

FILES = ("objects", "areas", "limits")
pytestmark = pytest.mark.slow
NAMES = [name for name, (file, _) in shipped_scenarios().items() if file.stem in FILES]
DURATION = 2.0
ENCOUNTER = 5.0  # With what moves.


def ticks(name, folder, text=""):
    scenario = load_scenario(name, text=f"{{planner: {{verify_contacts: true}}{text}}}")
    scenario.simulation_duration = ENCOUNTER if scenario.obstacles else DURATION
    records = []
    run(scenario, name=name, out=folder, recording=False, on_tick=records.append)
    return scenario, records


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_scenario_keeps_its_limits(name, tmp_path):
    scenario, records = ticks(name, tmp_path)
    resolved = resolve(scenario)
    surface, limits = resolved.surface, scenario.planner.limits
    contact_limits = limits.make_limits(scenario.planner.period, friction=0.7)
    radii = np.array(limits.tip_radii or [0.0] * resolved.num_contacts)
    before, active_before, quality = None, (), None
    for record in records:
        X_OW = record.X_WO_estimated.inverse()
        p_OC = (X_OW @ record.p_WC.T).T
        active = np.flatnonzero(is_active(record.contact_status))
        nearest, normals = surface.project(p_OC)
        assert np.max(np.linalg.norm(nearest - p_OC, axis=1)[active], initial=0) < 1e-9
        if limits.tip_radii:
            gaps = tip_gaps(p_OC, normals, radii)[np.ix_(active, active)]
            assert np.min(gaps, initial=np.inf) > -1e-8
        for obstacle in map(moving_solid, scenario.obstacles):
            solid = obstacle.solid.moved(np.eye(3), record.time * obstacle.velocity)
            p_WT = record.X_WO_estimated @ (p_OC + radii[:, None] * normals)[active].T
            gaps = solid.distance(p_WT.T) - radii[active] - limits.clearance
            assert np.min(gaps, initial=np.inf) > -1e-9
        if limits.reach:
            X_HW = scenario.hand.initial_X_WH(record.X_WO_estimated).inverse()
            for contact in active:
                p_HC = (X_HW @ record.p_WC[contact])[None]
                assert limits.reach[contact].make_reach().solid.distance(p_HC)[0] < 1e-9
        for pair in contact_limits.pairs:
            if pair.first in active and pair.second in active:
                assert pair.error(p_OC, normals) <= pair.tolerance + 1e-9
        if before is not None:
            steps = np.linalg.norm(p_OC - before, axis=1)
            assert np.max(steps[active], initial=0) <= contact_limits.max_step + 1e-9
        if contact_limits.guard is not None:
            # The first one only: on an edge, rounding chooses the normal that a margin goes by.
            value, *_ = contact_limits.guard(surface, p_OC[active], normals[active])
            if set(active) == set(active_before):
                assert value >= quality - 1e-9
            quality = value
        before, active_before = p_OC, active


def test_a_contact_under_an_obstacle_is_not_active_and_says_why(tmp_path):
    text = ", obstacles: [!BallObstacle {radius: 0.03, center: [0.06, -0.007, 0.02], body: false}]"
    _, records = ticks("a_base", tmp_path, text)
    # Contact 4 starts where the ball is.
    assert records[0].contact_status[4] == ContactStatus.OBSTRUCTED
    assert records[0].contact_causes[4] == 0
