"""A study that compares grasps with contacts planned once and contacts that adapt."""
