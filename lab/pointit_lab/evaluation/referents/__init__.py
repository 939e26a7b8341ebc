"""What people mean by words while they point: simulated speakers, the model and simpler rules."""
