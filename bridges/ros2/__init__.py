"""A node in a ROS 2 graph: shows PointIt to robots and reads their messages; needs no installed ROS."""
