"""Converters of ROS values to messages and queries, one per route; pure, without exceptions."""
