"""A map drawn from above. It needs matplotlib."""
