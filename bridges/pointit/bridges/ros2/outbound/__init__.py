"""Our messages as ROS values; pure, each function one route of `routes`."""
