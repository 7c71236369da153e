"""ROS 2 bridge: a run's skin as standard topics over rmw_zenoh's protocol, without a ROS 2 installation."""
