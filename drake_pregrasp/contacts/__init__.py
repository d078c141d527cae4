"""Contact goals inside safe regions: Eq. 3-7, limits on goals, and assignment of fingers."""
