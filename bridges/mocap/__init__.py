"""Motion capture (OptiTrack, Qualisys): bodies as tracked objects, robots, people, or ground truth."""
