"""Within one Context, each output follows each input that it depends on: no cache is stale."""

from dataclasses import replace

import numpy as np
import pytest
from driven import Driven
from made_systems import MAKERS, SETTINGS, VALUES, N, driven

from drake_pregrasp.grasping.grasp_state import GraspPhase, GraspState

FIRST = GraspState.first(N, SETTINGS)
TOUCHED = replace(FIRST, phase=GraspPhase.CLOSE, touched=np.ones(N, dtype=bool))


@pytest.mark.parametrize("name", MAKERS)
def test_outputs_follow_their_inputs(name):
    sound = driven(name)
    system, inputs = sound.system, sound.inputs

    def numbers(fresh):
        if name == "sequencer":  # With this state, forces depend on contacts.
            fresh.context.SetDiscreteState(0, TOUCHED.to_vector())
        return fresh.numbers()

    for port in inputs:
        changed = Driven(system, **inputs)
        before = numbers(changed)
        other = {port: VALUES[port][1]}
        changed.fix(**other)
        after = changed.numbers()
        np.testing.assert_array_equal(after, numbers(Driven(system, **(inputs | other))))
        index = system.GetInputPort(port).get_index()
        outputs = range(system.num_output_ports())
        is_used = any(system.HasDirectFeedthrough(index, output) for output in outputs)
        assert is_used != np.array_equal(after, before, equal_nan=True), port
