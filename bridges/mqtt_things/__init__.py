"""Things on an MQTT broker, for Home Assistant and others: `pointit run --mqtt`, in the process of a run."""
