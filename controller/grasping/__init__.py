"""Teaching by touch and grasping unknown objects with the whole upper body [M14, IV and V]."""
