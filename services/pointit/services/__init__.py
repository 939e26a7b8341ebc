"""Services that make the decisions. Each has its own folder and process."""
