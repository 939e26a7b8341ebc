"""Studies: run, checked, reported."""
