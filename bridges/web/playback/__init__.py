"""Playback in pages: of a recording, or of the last minutes of the running site."""
