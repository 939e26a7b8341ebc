"""The simulated person's decisions: what to point at, when to correct and press."""
