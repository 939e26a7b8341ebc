"""Driver of AGVs by VDA 5050, the standard interface of automated guided vehicles over MQTT."""
