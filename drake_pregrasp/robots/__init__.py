"""Robots whose models come from another package, made fit for simulation on first use."""
