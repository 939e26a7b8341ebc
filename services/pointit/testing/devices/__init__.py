"""Fake devices: what the author of a plug-in tests against, in place of hardware."""
