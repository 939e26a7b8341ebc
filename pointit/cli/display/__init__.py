"""The terminal's view of a run: live, and a summary at its end."""
