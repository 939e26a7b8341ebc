"""Localization by pointing, compared with baselines and bounds."""
