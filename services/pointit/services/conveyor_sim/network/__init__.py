"""The network of belts: geometry, junctions, routes and rings."""
