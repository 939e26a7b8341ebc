"""The life cycle of one person's interaction."""
