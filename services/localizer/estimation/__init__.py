"""From rays to a pose and its uncertainty, by least squares."""
