"""The benchmark: ticks, what else one could do, whole simulations, memory, and starting up."""
