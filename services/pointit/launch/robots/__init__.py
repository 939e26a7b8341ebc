"""Robots in a run: their users, landings and arrivals."""
