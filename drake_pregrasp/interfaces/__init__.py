"""Interfaces to other programs: recorded poses, MCAP logs, and LCM (extra `interfaces`)."""

PACKAGES = ("mcap", "rosbags")
"""Packages of the extra."""
