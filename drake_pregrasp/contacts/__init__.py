"""Contact goals inside safe regions: centroids, strategies, limits on goals, and assignment of fingers."""
