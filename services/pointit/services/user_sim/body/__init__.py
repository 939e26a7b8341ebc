"""The simulated body: arm, stance, noise and wristband."""
