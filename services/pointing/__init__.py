"""Arm orientation and body measures to the pointing ray."""
