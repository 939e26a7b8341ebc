"""States that outlive their writers, and the machines' clocks."""
