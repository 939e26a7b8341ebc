"""A node in a ROS 2 graph: shows PointIt to robots, takes what they send, needs nothing of ROS installed."""
