"""Packages on belts: motion and right of way."""
