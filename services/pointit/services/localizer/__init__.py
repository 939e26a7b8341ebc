"""Where the person stands: from a fixed pose, or from pointing at known places."""
