"""What a service is, and the process around it: options, lifetime, shutdown, log, one instance per name."""
