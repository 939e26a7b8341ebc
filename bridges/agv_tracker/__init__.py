"""AGVs that report at an MQTT broker by VDA 5050, as tracked objects."""
