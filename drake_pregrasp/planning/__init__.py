"""The mathematics of dynamic pre-grasp planning, equation by equation, without Drake."""
