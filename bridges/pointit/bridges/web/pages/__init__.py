"""Open pages: their websockets, what is new to them and what they ask for."""
