"""Localization of people: from a fixed pose, or from pointing at known places."""
