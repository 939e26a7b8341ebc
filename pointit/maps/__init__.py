"""The model of a map file, and the environment message made from it."""
