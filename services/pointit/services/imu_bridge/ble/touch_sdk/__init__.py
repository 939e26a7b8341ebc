"""Watches with the Touch SDK by Bluetooth Low Energy: a pure decoder of their messages, and the wrist."""
