"""Steering of robots by pointing: choosing one, and places to send it to, confirmed in two steps."""
