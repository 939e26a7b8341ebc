"""Vision of the simulated person: strips, lamps and objects."""
