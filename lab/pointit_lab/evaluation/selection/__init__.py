"""Selection by simulated and recorded people."""
