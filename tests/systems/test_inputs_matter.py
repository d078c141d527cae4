"""Within one Context, each output follows each input that it depends on: no cache is stale."""

from dataclasses import replace

import numpy as np
import pytest
from driven import Driven
from made_systems import CONTROL_PERIOD, MAKERS, NQ, PERIOD, SETTINGS, VALUES, X_G, N, driven

from drake_pregrasp import EstimatorConfig
from drake_pregrasp.arrays import pack
from drake_pregrasp.config.planner_config import filter_noise
from drake_pregrasp.estimation.pose_belief import NO_MEASUREMENT, no_belief
from drake_pregrasp.estimation.pose_track import PoseTrack
from drake_pregrasp.grasping.grasp_state import GraspPhase, GraspState
from drake_pregrasp.grasping.palm_paths import Meeting

FIRST = GraspState.first(N, SETTINGS)
ALL = np.ones(N, dtype=bool)
GRIPPED = replace(FIRST, active=ALL, touched=ALL, share=0.5, gripped=0.0)
MODELS = len(filter_noise(EstimatorConfig()).densities)
MEETING = replace(Meeting.above(0.1), time=1.0, meets=True)


def known_track(offset):
    """A track that knows the object at X_G, with the components of an offset of the sensor."""
    track = PoseTrack.empty(EstimatorConfig().late_measurements + 1, MODELS, offset)
    belief = replace(
        no_belief(MODELS, offset),
        time=-PERIOD,
        p_WCoM=np.tile(X_G.translation(), (MODELS, 1)),
        P=np.tile(1e-4 * np.eye(12 + offset), (MODELS, 1, 1)),
    )
    track.steps[-1] = np.append(pack(replace(NO_MEASUREMENT, time=-PERIOD)), pack(belief))
    return replace(track, V_held=np.zeros(6), confirmed_at=-PERIOD)


@pytest.mark.parametrize("name", MAKERS)
def test_outputs_follow_their_inputs(name):
    sound = driven(name)
    system, inputs = sound.system, sound.inputs

    def numbers(fresh, port):
        # While it closes, forces depend on contacts; in the squeeze, X_WG on tips and their forces.
        if name == "sequencer" and port != "approach":
            squeezes = port in ("p_WT", "f_T_W")
            phase = GraspPhase.SQUEEZE if squeezes else GraspPhase.CLOSE
            fresh.context.SetDiscreteState(0, replace(GRIPPED, phase=phase).to_vector())
            fresh.context.SetDiscreteState(3, np.arange(3.0 * N))
            fresh.context.SetTime(CONTROL_PERIOD)
        if name == "kinematics":  # Forces are limited, so that measured positions matter.
            fresh.context.SetDiscreteState(1, np.repeat([0.0, 0.1, 0.5], [NQ, 2 * N, 3 * N]))
        if name == "interception":  # With this plan, the palm follows the object.
            fresh.context.SetDiscreteState(0, pack(MEETING))
        if name.startswith("estimator"):  # With this state, the estimate depends on all its inputs.
            fresh.context.SetDiscreteState(0, [-PERIOD])
            fresh.context.SetDiscreteState(1, pack(known_track(3 * name.endswith("points"))))
        return fresh.numbers()

    for port in inputs:
        changed = Driven(system, **inputs)
        before = numbers(changed, port)
        other = {port: VALUES[port][1]}
        changed.fix(**other)
        after = changed.numbers()
        np.testing.assert_array_equal(after, numbers(Driven(system, **(inputs | other)), port))
        index = system.GetInputPort(port).get_index()
        outputs = range(system.num_output_ports())
        is_used = any(system.HasDirectFeedthrough(index, output) for output in outputs)
        assert is_used != np.array_equal(after, before, equal_nan=True), port
