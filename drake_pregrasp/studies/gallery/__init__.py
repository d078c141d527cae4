"""Pictures and films of the shipped scenarios and hands."""
