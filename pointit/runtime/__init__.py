"""The parts that all services share: bus, clock, configuration, logs, health, start and shutdown."""
