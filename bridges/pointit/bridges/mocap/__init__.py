"""Motion capture: bodies of OptiTrack Motive as tracked objects, robots and people, or as ground truth."""
