"""Replays of recordings: the recorded services run again on what the edge of the site wrote, in its time."""
