"""Specs of the controller: nursing, teaching and grasping."""
