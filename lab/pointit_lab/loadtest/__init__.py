"""The load test: the number of people that a machine carries."""
