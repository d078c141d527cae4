"""Sweeps: one scenario, simulated with many values of any of its fields."""
