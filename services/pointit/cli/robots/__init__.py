"""Robots: listed and stopped, and drawn in the view of a run."""
