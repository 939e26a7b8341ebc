"""Routes between ROS names and our topics."""
