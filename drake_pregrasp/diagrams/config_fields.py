"""What the fields of several configurations have in common."""


def zeros() -> list[float]:
    """Returns three zeros: a default for points, directions and angles."""
    return [0.0, 0.0, 0.0]
