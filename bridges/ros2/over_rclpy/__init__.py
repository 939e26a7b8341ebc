"""The ROS graph through an installed ROS, by any of its middlewares, DDS above all."""
