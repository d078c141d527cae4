"""Study of look-ahead on fast objects."""
