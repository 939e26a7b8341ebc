"""Lamps of the map as smart lamps on an MQTT broker: Zigbee2MQTT, and the JSON schema of Home Assistant."""
