"""The ROS graph through an installed ROS: whatever that speaks, DDS above all."""
