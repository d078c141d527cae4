"""One trial of the study: an object, a hand, a speed and a method, with a random start yaw."""

from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drake_pregrasp.config.grasp_config import SIDE
from drake_pregrasp.config.object_config import Conveyor
from drake_pregrasp.errors import NoGraspError, PregraspError, ScenarioError, one_line
from drake_pregrasp.simulation.hand_file import HandFile
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario, resolve_scenario
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.scenario_file import load_scenario
from drake_pregrasp.studies.objects import object_sets
from drake_pregrasp.studies.static_versus_dynamic import trial
from drake_pregrasp.studies.static_versus_dynamic.grasp_outcome import Outcome
from drake_pregrasp.studies.static_versus_dynamic.methods import METHODS

MODULES = (__name__, object_sets.__name__, *trial.MODULES)
"""Modules on which the rows of the study depend."""

REFUSED = "refused"
"""Cause of a failure before the simulation, which the missing property may follow."""

TURN_PER_SPEED = np.radians(10) / 20
"""Turning rate of the conveyor for each mm/s of its speed, in rad/s."""


class ObjectJob(NamedTuple):
    """One trial of the study.

    Attributes:
        set: Key of the set of the object.
        object: Name of the object in its set.
        hand: Name of a shipped hand, or the path of a hand's file.
        speed: Speed of the conveyor, in mm/s.
        method: Key of `METHODS`.
        seed: Seed of the start yaw and of the noise.
        text: YAML that overrides keys of the scenario.
    """

    set: str
    object: str
    hand: str
    speed: float
    method: str
    seed: int
    text: str = "{}"


def base_scenario(text: str) -> Scenario:
    """Returns the scenario that trials change, with keys from a YAML text.

    Raises:
        ScenarioError: If the text is invalid.
    """
    return load_scenario("trial", file=Path(__file__).with_name("objects.yaml"), text=text)


def make_scenario(job: ObjectJob) -> ResolvedScenario:
    """Returns the scenario of a trial.

    The palm comes from above, or from the side if there is no grasp from above.

    Raises:
        ScenarioError: If the hand cannot grasp the object there.
    """
    base, hand = base_scenario(job.text), object_sets.hand_file(job.hand)
    yaw = np.random.default_rng([job.seed, *job.object.encode()]).uniform(-np.pi, np.pi)
    scenario = replace(
        base,
        object=object_sets.SETS[job.set]()[job.object],
        motion=Conveyor(1e-3 * job.speed, TURN_PER_SPEED * job.speed, yaw=float(yaw)),
        hand=HandFile(hand),
        random_seed=job.seed,
    )
    source = f"{job.set} {job.object}"
    try:
        return resolve_scenario(scenario, source)
    except ScenarioError as error:
        if not isinstance(error.__cause__, NoGraspError):
            raise
        from_side = replace(scenario, grasp=replace(scenario.grasp, approaches=[SIDE]))
        try:
            return resolve_scenario(from_side, source)
        except ScenarioError:
            raise error from error.__cause__


def make_trial(job: ObjectJob) -> trial.Trial:
    """Returns the trial of a job.

    Raises:
        PregraspError: If the hand cannot grasp the object there.
    """
    resolved, method = make_scenario(job), METHODS[job.method]
    if method.is_stationary or method.is_reactive:  # These choose contacts for all fingers.
        everywhere = np.ones(resolved.num_contacts, dtype=bool)
        resolved = replace(resolved, start=replace(resolved.start, has_contact=everywhere))
    return trial.Trial(resolved, method, np.zeros(3))


def run_trial(job: ObjectJob) -> Mapping[str, Any]:
    """Simulates a trial, and returns its row: the `Outcome`, and whether the object was held."""
    try:
        made = make_trial(job)
    except PregraspError as error:
        nothing = dict.fromkeys((field.name for field in fields(Outcome)), np.nan)
        lack = error.__cause__.lack if isinstance(error.__cause__, NoGraspError) else ""
        cause = f"{REFUSED}: {lack}" if lack else REFUSED
        refused = {"lifted": False, "level": False, "gave_up": one_line(error), "cause": cause}
        return nothing | refused | {"held": False}
    (outcome,) = made.outcomes([made.resolved.scenario.grasp.close_at])
    return asdict(outcome) | {"held": outcome.lifted}
