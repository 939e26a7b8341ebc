"""Things that are entities of a Home Assistant: pointing at them acts there, and their state comes back."""
