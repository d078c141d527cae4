"""Connections and exported ports of diagrams, by the names of ports."""

from pydrake.systems.framework import DiagramBuilder, System


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
