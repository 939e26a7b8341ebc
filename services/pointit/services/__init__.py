"""What decides: one folder, one process."""
