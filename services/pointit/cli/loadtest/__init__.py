"""The load test: how many people a machine carries."""
