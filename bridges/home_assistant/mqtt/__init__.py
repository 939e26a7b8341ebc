"""Lights of a home without Home Assistant, which announce themselves on an MQTT broker."""
