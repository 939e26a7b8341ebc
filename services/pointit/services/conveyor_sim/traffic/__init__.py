"""Packages on belts: motion, gaps and right of way."""
