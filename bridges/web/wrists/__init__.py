"""Mice and phones as wrists."""
