"""Connections of ports by their names."""

import pytest
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.diagrams.wiring import connect_inputs


class Emitter(LeafSystem):
    def __init__(self, value, *names):
        super().__init__()
        for name in names:
            self.DeclareVectorOutputPort(name, 1, lambda context, out: out.SetAtIndex(0, value))


class Reader(LeafSystem):
    def __init__(self, *names):
        super().__init__()
        for name in names:
            self.DeclareVectorInputPort(name, 1)


def connected(*names):
    builder = DiagramBuilder()
    first, second = (
        builder.AddSystem(Emitter(value, *ports))
        for value, ports in ((1.0, ("p_WC", "close")), (2.0, ("close", "obstacles")))
    )
    reader = builder.AddSystem(Reader(*names))
    connect_inputs(builder, reader, first, second)
    diagram = builder.Build()
    context = reader.GetMyContextFromRoot(diagram.CreateDefaultContext())
    return [reader.GetInputPort(name).Eval(context)[0] for name in names]


def test_each_input_gets_the_first_output_of_its_name():
    assert connected("obstacles", "close", "p_WC") == [2.0, 1.0, 1.0]


def test_a_name_that_no_output_has_is_refused_with_the_nearest_one():
    with pytest.raises(InvalidArgumentError, match="Reader: input port obstacle: no such output"):
        connected("close", "obstacle")
    with pytest.raises(InvalidArgumentError, match="did you mean obstacles"):
        connected("obstacle")
