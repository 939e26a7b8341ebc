"""Where objects lie about a ray at the time of its capture."""
