"""Robots in a run: who steers each, where they landed and arrived."""
