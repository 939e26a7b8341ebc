"""Wrists on a serial port: one source, and a framer for each format."""
