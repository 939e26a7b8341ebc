"""The robot of a recording."""
