"""Open pages: their websockets, unsent changes and requests."""
