"""Single lamps as smart lights on an MQTT broker: Zigbee2MQTT, and the JSON schema of Home Assistant."""
