"""Converters of messages to ROS values; pure, each function one route of `routes`."""
