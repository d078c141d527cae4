"""Simulated grasps of a study: sources of goals, trials and their outcomes."""
