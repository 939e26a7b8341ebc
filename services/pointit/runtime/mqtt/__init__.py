"""Connection to MQTT brokers."""
