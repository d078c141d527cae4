"""The planner's parts as Drake systems, one a file; all are defined for the scalar type float."""
