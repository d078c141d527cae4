"""Grasping: phases, meetings, paths of fingertips, and kinematics of a hand."""
