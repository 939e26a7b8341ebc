"""Joining a ROS graph and watching it."""
