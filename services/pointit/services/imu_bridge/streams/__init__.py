"""Contents that cables and networks share: which sensor of a stream is used, JSON, and text in messages."""
