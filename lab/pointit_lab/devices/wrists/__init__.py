"""Wrists in software: the device's side of their protocols."""
