"""Whatever comes to a port: outputs are finite, and the next sound value is as good as before."""

import numpy as np
import pytest
from broken_values import broken_values
from driven import Driven, port_names
from five_finger_hand import FRAMES
from made_systems import (
    MAKERS,
    P_OC,
    SURFACE,
    UNCONNECTED,
    VALUES,
    planner_config,
)
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BusValue, PortDataType

import drake_pregrasp as dp
from drake_pregrasp.regions.safe_regions import SafeRegions

VALID_BY_TYPE = {"command", "goals", "safe_regions"}
"""Ports between systems of this package, whose values a system checked that made them."""


SYSTEMS = MAKERS | {"planner": lambda: dp.PregraspPlanner(planner_config(), SURFACE, P_OC)}
PASSED_ON = {
    "sensor": {"X_WO_measured"},  # A broken measurement is one that the estimator refuses.
    "sensor with memory": {"X_WO_measured", "measurement_time"},
    "sensor of a camera": {"X_WO_measured", "measurement_time"},
    "hand pose": {"X_WH"},
    "fingertip sensor": {"p_WT", "f_T_W", "J_WT"},  # Nothing is known where the joints are not.
    "interception": {"approach", "catch_certificate"},  # Without a meeting, its time is unknown.
    "sequencer": {"V_WO_held"},  # Where no hand holds the object, there is no such velocity.
}
"""Outputs that say by NaN that something is not known."""

KEPT = {
    "estimator of points": {"X_WO_estimated", "camera_offset"},
    "interception": {"approach", "catch_certificate"},
    "sequencer": {"grasp_report"},
    "planner": {"p_WC", "p_WC_previous", "fingertip_targets", "safe_regions"},
}
"""Outputs that depend on the past: where touches of long ago said that a camera is, when a phase
began, meetings, and where contacts came from."""

SETTLED = 4.0  # Seconds of sound values, after which all is as if nothing had been.


def sound_inputs(name, system):
    """A sound value of each port that the system's settings use."""
    names = [port for port in port_names(system)[0] if port not in UNCONNECTED.get(name, ())]
    ports = {name: system.GetInputPort(name) for name in names}
    vectors = PortDataType.kVectorValued
    unused = {n for n, p in ports.items() if p.get_data_type() == vectors and not p.size()}
    return {name: VALUES[name][0] for name in names if name not in unused}


def assert_finite(player, name, port):
    _, outputs = port_names(player.system)
    for output in outputs:
        is_finite = np.isfinite(player.array(output)).all()
        assert is_finite or output in PASSED_ON.get(name, ()), (port, output)


@pytest.mark.slow
@pytest.mark.parametrize("name", SYSTEMS)
def test_a_broken_value_spoils_no_output_and_is_forgotten(name):
    system = SYSTEMS[name]()
    inputs = sound_inputs(name, system)
    for port in inputs.keys() - VALID_BY_TYPE:
        player, undisturbed = Driven(system, **inputs), Driven(system, **inputs)
        player.tick(4)
        for value in broken_values(inputs[port]):
            player.fix(**{port: value})
            assert_finite(player, name, port)
            player.tick(2)
            assert_finite(player, name, port)
            player.fix(**{port: inputs[port]})
            player.tick()
            assert_finite(player, name, port)
        if player.period:
            player.tick(round(SETTLED / player.period))
            undisturbed.tick(round(player.context.get_time() / player.period))
        for output in port_names(system)[1]:
            if output not in KEPT.get(name, ()):
                expected = undisturbed.array(output)
                np.testing.assert_allclose(player.array(output), expected, atol=1e-5, rtol=0)


WRONG_BUS = BusValue()
WRONG_BUS.Set(FRAMES[0], AbstractValue.Make(3.0))


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_value_of_another_type_is_refused_by_the_ports_name(name):
    system = SYSTEMS[name]()
    inputs = sound_inputs(name, system)
    for port, sound in inputs.items():
        if isinstance(sound, BusValue | dp.Obstacles | SafeRegions):  # Drake refuses the others.
            wrong = WRONG_BUS if isinstance(sound, BusValue) else AbstractValue.Make(object())
            player = Driven(system, **inputs | {port: wrong})
            with pytest.raises(dp.InvalidArgumentError, match=f"port {port}"):
                player.next_numbers()
