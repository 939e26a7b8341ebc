"""Simulation without a bus: recordings, aim and accuracy."""
