"""Robots with models from another package, which are converted for Drake on first use."""
