"""Owners and reservations of objects, and the right to change them."""
