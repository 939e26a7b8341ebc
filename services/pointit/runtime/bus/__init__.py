"""The typed bus: its contract, the bus within one process, and a service's view of it, which measures."""
