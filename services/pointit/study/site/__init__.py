"""Site of a session: its scenario, display, audio and streams."""
