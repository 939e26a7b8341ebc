"""Objects that move on belts, or on strips taken as belts."""
