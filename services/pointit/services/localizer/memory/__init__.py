"""Systematic errors of a person's pointing, as the prior of their next localization."""
