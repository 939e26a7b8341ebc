"""Which thing of a room people mean: simulated reaches with recorded errors, with and without light."""
