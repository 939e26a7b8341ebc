"""DMX over the network: E1.31 (sACN) and Art-Net."""
