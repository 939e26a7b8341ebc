"""The conveyor's state on disk."""
