"""Whether hands grasp better when contacts are planned anew while the object moves: a study."""
