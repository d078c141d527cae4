"""Grasp quality: contact models, the measures and classification of the paper, and force closure."""
