"""Connection to MQTT brokers, and messages of devices there that several processes read."""
