"""Typed bus: its contract, the bus within one process, and the measured bus of a service."""
