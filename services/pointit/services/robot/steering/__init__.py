"""Steering of a robot by its person."""
