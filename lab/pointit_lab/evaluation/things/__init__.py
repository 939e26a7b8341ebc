"""Things that people mean: simulated reaches with recorded errors, with and without light."""
