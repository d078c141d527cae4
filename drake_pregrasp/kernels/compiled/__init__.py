"""What the numba kernel calls: functions that are compiled once, and kept."""
