"""Environment of the robot: stand, objects, payload."""
