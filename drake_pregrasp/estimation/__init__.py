"""Estimation of the object's pose, and faults of its measurements."""
