"""Grasping: phases, squeeze forces, and paths of fingertips."""
