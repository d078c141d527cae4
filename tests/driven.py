"""A driver for a system on its own."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.perception import PointCloud
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BusValue

from drake_pregrasp import Obstacles
from drake_pregrasp.arrays import pack
from drake_pregrasp.grasping.hand_commands import GraspCommand
from drake_pregrasp.grasping.hand_goals import HandGoals
from drake_pregrasp.regions.safe_regions import SafeRegions

_ABSTRACT = BusValue | Obstacles | PointCloud | SafeRegions | GraspCommand | HandGoals


class Driven:
    """A system on its own whose inputs are set, and whose clock goes from tick to tick."""

    def __init__(self, system, **inputs):
        self.system, self.inputs = system, inputs
        timing = system.GetUniquePeriodicDiscreteUpdateAttribute()
        self.period = timing.period_sec() if timing else 0.0
        self.simulator = Simulator(system)
        self.context = self.simulator.get_mutable_context()
        self.fix(**inputs)

    def fix(self, **inputs):
        for port, value in inputs.items():
            if isinstance(value, _ABSTRACT):
                value = AbstractValue.Make(value)
            self.system.GetInputPort(port).FixValue(self.context, value)

    def at(self, time, **inputs):
        """Sets the time without an update."""
        self.context.SetTime(time)
        self.fix(**inputs)

    def update(self):
        """Makes the discrete update of a tick, and stays at its time."""
        if self.period:
            changed = self.system.EvalUniquePeriodicDiscreteUpdate(self.context)
            self.context.SetDiscreteState(changed)

    def publish(self):
        self.system.ForcedPublish(self.context)

    def advance(self, seconds):
        self.simulator.AdvanceTo(self.context.get_time() + seconds)

    def tick(self, count=1):
        """Advances to the exact time of a later tick, so that each tick is made once."""
        if self.period:
            ticks = round(self.context.get_time() / self.period) + count
            self.simulator.AdvanceTo(ticks * self.period)

    def eval(self, port):
        return self.system.GetOutputPort(port).Eval(self.context)

    def array(self, port):
        return plain(self.eval(port)).copy()

    def next_numbers(self):
        self.tick()
        return self.numbers()

    def numbers(self):
        """All outputs as one vector."""
        _, outputs = port_names(self.system)
        return np.concatenate([self.array(port).ravel() for port in outputs])


def port_names(system):
    """Names of the input ports and of the output ports, in their order."""
    inputs = [system.get_input_port(i).get_name() for i in range(system.num_input_ports())]
    outputs = [system.get_output_port(i).get_name() for i in range(system.num_output_ports())]
    return inputs, outputs


def plain(value):
    """A port's value as an array."""
    if isinstance(value, RigidTransform):
        return value.GetAsMatrix34()
    if isinstance(value, SpatialVelocity):
        return value.get_coeffs().copy()
    if isinstance(value, GraspCommand | HandGoals):
        return pack(value)
    if isinstance(value, SafeRegions):
        return value.labels.copy()
    if isinstance(value, BusValue):
        return np.array([plain(value.Find(name)) for name in sorted(value)])
    return np.array(value)
