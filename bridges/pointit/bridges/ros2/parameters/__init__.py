"""Parameters of ROS nodes, and maps kept in them."""
