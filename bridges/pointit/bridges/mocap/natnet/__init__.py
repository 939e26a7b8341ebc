"""NatNet, the protocol of OptiTrack Motive: packets, clock, session, sockets, search."""
