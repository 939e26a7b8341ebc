"""Places pointed at in two steps become goals for a robot."""
