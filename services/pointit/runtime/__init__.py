"""What running services share: bus, clock, configuration, logs, health, life and end."""
