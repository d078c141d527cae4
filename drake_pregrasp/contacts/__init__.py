"""Contact goals: centroids, strategies, limits on goals, and assignment of fingers."""
