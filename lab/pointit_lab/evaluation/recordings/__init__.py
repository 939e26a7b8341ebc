"""Files of recordings and of results, and work over several processes."""
