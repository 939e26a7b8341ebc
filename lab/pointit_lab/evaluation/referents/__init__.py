"""Referents of words of people who point: simulated speakers, the model and simpler rules."""
