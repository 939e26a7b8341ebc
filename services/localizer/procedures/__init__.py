"""Localization procedures: static lamps, moving targets, external trackers."""
