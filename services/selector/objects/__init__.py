"""Positions of objects about a ray at the time of its capture."""
