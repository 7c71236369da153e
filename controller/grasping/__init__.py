"""Teaching by touch and grasping: what the robot is taught, and what it makes of it."""
