"""Surfaces, shapes and solids: the geometry of the object, without Drake."""
