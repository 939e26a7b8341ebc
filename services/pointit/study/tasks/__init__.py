"""Tasks: the target of each trial, and its place in the room."""
