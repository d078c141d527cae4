"""The study of look-ahead on fast objects."""
