"""Wiring: the systems put together into diagrams."""
