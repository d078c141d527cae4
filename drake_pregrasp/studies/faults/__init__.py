"""How the planner stands up to measurements that are late, lost, repeated or wrong."""
