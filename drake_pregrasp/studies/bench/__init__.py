"""Benchmark of planning ticks, the whole simulation, start-up, memory, and long runs."""
