"""Simulation of scenario files, with results in run folders."""
