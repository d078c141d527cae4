"""Grasp quality: contact models, the measures of the paper, Eq. 8-9, and force closure."""
