"""The site of a session: its scenario, what is shown and heard there, its streams."""
