"""The controller's own model of the robot: kinematics, errors, limits, mobility."""
