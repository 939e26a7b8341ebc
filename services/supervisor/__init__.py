"""The state machine of one person's interaction: idle, localizing, pointing. It supervises no processes."""
