"""Scans of rooms: simulated rooms and cameras, and how far off a scan is."""
