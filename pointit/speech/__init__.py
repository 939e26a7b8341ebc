"""Spoken commands of people who point: recognisers, a small grammar, and what is done."""
