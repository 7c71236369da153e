"""The skin of a run as ordinary ROS 2 topics, spoken without ROS 2."""
