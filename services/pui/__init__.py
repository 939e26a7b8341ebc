"""Pointing rays, poses and a map of the room to cursors."""
