"""Connections and exported ports of diagrams, by the names of ports."""

from pydrake.systems.framework import DiagramBuilder, System

from drake_pregrasp.errors import InvalidArgumentError, nearest


def connect(builder: DiagramBuilder, source: System, names: str, *targets: System) -> None:
    """Connects output ports of a system to the input ports of the same names.

    Args:
        builder: Builder of the diagram.
        source: System with the output ports.
        names: Names of the ports, separated by spaces; `out:in` for two different names.
        targets: Systems with the input ports.
    """
    for name in names.split():
        output, _, target_input = name.partition(":")
        for target in targets:
            port = target.GetInputPort(target_input or output)
            builder.Connect(source.GetOutputPort(output), port)


def connect_inputs(builder: DiagramBuilder, target: System, *sources: System) -> None:
    """Connects all input ports of a system to the output ports of the same names.

    Args:
        builder: Builder of the diagram.
        target: System with the input ports.
        sources: Systems with the output ports; the first one with a name counts.

    Raises:
        InvalidArgumentError: If no source has an output port of a name.
    """
    for port in map(target.get_input_port, range(target.num_input_ports())):
        name = port.get_name()
        source = next((source for source in sources if source.HasOutputPort(name)), None)
        if source is None:
            names = [
                source.get_output_port(index).get_name()
                for source in sources
                for index in range(source.num_output_ports())
            ]
            problem = f"{type(target).__name__}: input port {name}: no such output port"
            raise InvalidArgumentError(f"{problem}; {nearest(name, names)}")
        builder.Connect(source.GetOutputPort(name), port)


def export_inputs(builder: DiagramBuilder, names: str, *systems: System) -> None:
    """Exports input ports under their own names, each for all of the systems together.

    Args:
        builder: Builder of the diagram.
        names: Names of the ports, separated by spaces.
        systems: Systems, each of which has all of the ports.
    """
    for name in names.split():
        first, *others = systems
        builder.ExportInput(first.GetInputPort(name), name)
        for system in others:
            builder.ConnectInput(name, system.GetInputPort(name))


def export_outputs(builder: DiagramBuilder, system: System, names: str) -> None:
    """Exports output ports of a system under their own names, separated by spaces."""
    for name in names.split():
        builder.ExportOutput(system.GetOutputPort(name), name)
