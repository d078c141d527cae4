"""Within one Context, each output follows each input that it depends on: no cache is stale."""

from dataclasses import replace

import numpy as np
import pytest
from driven import Driven
from made_systems import CASES, SETTINGS, N, sound_inputs

from drake_pregrasp.grasping.grasp_state import GraspPhase, GraspState

FIRST = GraspState.first(N, SETTINGS)
TOUCHED = replace(FIRST, phase=GraspPhase.CLOSE, touched=np.ones(N, dtype=bool))


@pytest.mark.parametrize("name", CASES)
def test_outputs_follow_their_inputs(name):
    make, values = CASES[name]
    system, sound = make(), sound_inputs(name)

    def fixed(inputs):
        driven = Driven(system, **inputs)
        if name == "sequencer":  # With this state, forces depend on contacts.
            driven.context.SetDiscreteState(0, TOUCHED.to_vector())
        return driven

    for port, (_, other) in values.items():
        driven = fixed(sound)
        before = driven.numbers()
        driven.fix(**{port: other})
        after = driven.numbers()
        np.testing.assert_array_equal(after, fixed(sound | {port: other}).numbers())
        index = system.GetInputPort(port).get_index()
        outputs = range(system.num_output_ports())
        is_used = any(system.HasDirectFeedthrough(index, output) for output in outputs)
        assert is_used != np.array_equal(after, before, equal_nan=True), port
