"""Study that compares grasps with contacts that are planned once and contacts that adapt."""
