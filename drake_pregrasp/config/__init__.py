"""Settings of objects, sensors, planners and hands: the dataclasses behind YAML files."""
