"""A map drawn from above. All but `floor` needs matplotlib."""
