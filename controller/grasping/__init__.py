"""Tactile teaching, and grasping of unknown objects with the whole upper body [M14, IV and V]."""
