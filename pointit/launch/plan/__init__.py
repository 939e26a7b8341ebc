"""From a scenario and the user's choices to a checked plan of services."""
