"""Permitted places and speeds of a robot, and its reasons to stop: no safety function."""
