"""Which poses are taken: of rays that follow, and of pointings that agree."""
