"""Wrists by Bluetooth Low Energy: a pure protocol each, and one link over bleak that they share."""
