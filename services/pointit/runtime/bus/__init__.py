"""The contract of the typed bus, and the bus within one process."""
