"""Simulated people who place the lamps of their homes, with what goes wrong."""
