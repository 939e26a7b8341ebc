"""Systematic pointing errors and drift."""
