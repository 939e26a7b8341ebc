"""What the simulated person sees of strips, lamps and objects."""
