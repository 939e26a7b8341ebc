"""Services and the process around them: options, lifetime, shutdown, log, one instance per name."""
