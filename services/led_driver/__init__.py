"""Cursors, objects and their state to the pixels of LED strips, and to their controllers."""
