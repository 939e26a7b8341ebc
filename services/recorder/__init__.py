"""Records what travels on the site in a file."""
