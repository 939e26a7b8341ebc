"""The machine: threads, atomic file writes, state files, serial ports, TCP timeouts."""
