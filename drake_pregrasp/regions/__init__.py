"""Safe regions: Eq. 1-2, and the constraints beside it."""
