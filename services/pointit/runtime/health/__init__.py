"""Traffic, durations and timeliness, measured where a service meets the bus."""
