"""Studies made with the simulations: benchmarks and experiments."""
