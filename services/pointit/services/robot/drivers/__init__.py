"""Back-ends of robots."""
