"""Recordings as tables for analyses, and recordings from other sources."""
