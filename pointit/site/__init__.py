"""Newest messages and presences of a site, by the same rules for everybody who shows it."""
