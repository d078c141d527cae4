"""The part of `summary.json` that says how far the goals are from losing force closure."""

from typing import Any

import numpy as np

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.contact_status import is_active
from drake_pregrasp.planning.force_closure import ferrari_canny, min_weight_margin
from drake_pregrasp.planning.independent_regions import force_closed_share
from drake_pregrasp.planning.surface import ObjectSurface
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.tick_logger import TickRecord

_MEASURES = ("force_closure_margin", "ferrari_canny", "independent_region_share")


def force_closure_summary(
    scenario: Scenario,
    surface: ObjectSurface,
    *,
    static: TickRecord | None,
    final: TickRecord | None,
) -> dict[str, dict[str, Any]]:
    """Returns three measures of the active contacts, with what they assume, by their names.

    `force_closure_margin` is the min-weight margin, `ferrari_canny` the radius in newtons, and
    `independent_region_share` says how many choices of one point a safe region of these contacts
    are force-closed.

    Args:
        scenario: What was simulated; `measures` says how to measure.
        surface: The object's surface.
        static: The tick to measure as `static`; if None, its values are null.
        final: The same as `final`.
    """
    measures = scenario.measures
    model = "hard_finger" if measures.contact_model == "complete" else measures.contact_model
    columns = [_measure(scenario, surface, model, record) for record in (static, final)]
    return {
        name: {
            "friction": measures.friction,
            "contact_model": model,
            "static": columns[0][index],
            "final": columns[1][index],
        }
        for index, name in enumerate(_MEASURES)
    }


def _measure(
    scenario: Scenario, surface: ObjectSurface, model: str, record: TickRecord | None
) -> tuple[float | None, ...]:
    if record is None:
        return (None,) * len(_MEASURES)
    measures = scenario.measures
    p_OC: FloatArray = (record.X_WO_estimated.inverse() @ record.p_WC.T).T
    p_OC = p_OC[is_active(record.contact_status)]
    _, nhat = surface.project(p_OC)
    cone: dict[str, Any] = {"model": model, "torsional_friction": measures.torsional_friction}
    return (
        min_weight_margin(p_OC - surface.p_OCoM, nhat, measures.friction, **cone),
        ferrari_canny(
            p_OC - surface.p_OCoM,
            nhat,
            measures.friction,
            length=measures.length or surface.longest_lever_arm,
            **cone,
        ),
        force_closed_share(
            surface,
            record.regions,
            measures.friction,
            generator=np.random.default_rng(scenario.random_seed),
            **cone,
        ),
    )
