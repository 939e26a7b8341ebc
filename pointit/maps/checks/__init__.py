"""Checks that find mistakes in a map."""
