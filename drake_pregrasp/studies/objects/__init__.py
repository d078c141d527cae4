"""Study of grasps of many objects by many hands."""
