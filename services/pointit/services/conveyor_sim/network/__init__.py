"""The network of belts: geometry, routes, zones and rings."""
