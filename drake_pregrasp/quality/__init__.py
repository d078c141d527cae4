"""Grasp quality: contact models, measures, classification, and force closure."""
