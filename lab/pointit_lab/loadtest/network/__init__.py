"""The simulated machines of a load test: their links, routers and what crosses."""
