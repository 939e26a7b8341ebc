"""Robots: landing, identification, localization by following."""
