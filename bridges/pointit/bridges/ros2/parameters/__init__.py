"""Parameters of ROS nodes, and maps stored in them."""
