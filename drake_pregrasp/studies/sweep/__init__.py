"""Sweeps: simulations of one scenario with many values of any of its fields."""
