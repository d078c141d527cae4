"""Geometry of the object without Drake: surfaces, shapes and solids."""
