"""Yaw and true pose of people who wear marker bodies, for all sources of such bodies."""
