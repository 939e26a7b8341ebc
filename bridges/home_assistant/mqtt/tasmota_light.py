"""A light of a Tasmota, which announces itself in its own way from version 12 on. Pure.

https://tasmota.github.io/docs/MQTT: `tasmota/discovery/MAC/config` has the topics, words and relays of a
device. A Tasmota of `SetOption19 1` announces itself by Home Assistant's discovery instead.
"""

from typing import Any

from pointit.bridges.home_assistant.mqtt.announced_light import AnnouncedLight, LightCommand
from pointit.runtime.mqtt.discovery import LightConfig, items, json_value, label, mapping, text

DISCOVERY = "tasmota/discovery"
FILTER = f"{DISCOVERY}/+/config"
"""Filter of the topics on which devices announce themselves."""
RELAY = 1
LIGHT = 2
"""Values of `rl`, the outputs of a device."""
RELAYS_ARE_LIGHTS = "30"
"""Option, `SetOption30`, by which relays are lights."""
MAX_DIMMER = 100


def is_tasmota(topic: str) -> bool:
    """Return True for a topic on which a Tasmota announces itself."""
    return topic.startswith(f"{DISCOVERY}/") and topic.endswith("/config")


def tasmota_configs(payload: bytes) -> list[LightConfig]:
    """Return the lights that a Tasmota announces, with the fields of Home Assistant's discovery."""
    device = mapping(json_value(payload))
    prefixes = [text(prefix) for prefix in items(device.get("tp"))]
    outputs = items(device.get("rl"))
    mac = text(device.get("mac"))
    if len(prefixes) != 3 or not mac:
        return []
    has_lit_relays = mapping(device.get("so")).get(RELAYS_ARE_LIGHTS) == 1
    lights = [number for number, output in enumerate(outputs) if output == LIGHT]
    relays = [number for number, output in enumerate(outputs) if output == RELAY and has_lit_relays]
    is_alone = len([output for output in outputs if output]) == 1
    command, state, telemetry = (_topic_of(device, prefix) for prefix in prefixes)
    words = [text(word) for word in items(device.get("state"))] or ["OFF", "ON"]
    names = [label(name) for name in items(device.get("fn"))]
    device_name = label(device.get("dn"))
    configs: list[LightConfig] = []
    for number in sorted(lights + relays):
        name = names[number] if number < len(names) else ""
        fields: dict[str, Any] = {
            "name": name or device_name or mac,
            "command_topic": f"{command}POWER{number + 1}",
            "state_topic": f"{state}RESULT",
            "telemetry_topic": f"{telemetry}STATE",
            "request_topic": f"{command}STATE",
            "power": "POWER" if is_alone else f"POWER{number + 1}",
            "payload_off": words[0],
            "payload_on": words[-1] if len(words) < 2 else words[1],
            "availability_topic": f"{telemetry}LWT",
            "payload_available": text(device.get("onln")) or "Online",
            "payload_not_available": text(device.get("ofln")) or "Offline",
            "brightness_scale": MAX_DIMMER,
            "device": {"identifiers": [mac], "name": device_name},
        }
        # Of several lights each has a channel, and `Dimmer` is for all
        if lights == [number]:
            fields["brightness_command_topic"] = f"{command}Dimmer"
        configs.append(LightConfig(f"tasmota_{mac.lower()}_{number + 1}", fields))
    return configs


class TasmotaLight(AnnouncedLight):
    """A light whose reports of either topic are objects with `POWER` and `Dimmer`."""

    def _read_schema(self) -> None:
        super()._read_schema()
        self._telemetry_topic = self._topic("telemetry_topic")
        self._request_topic = self._topic("request_topic")
        self._power = text(self._fields.get("power"))

    @property
    def topics(self) -> set[str]:
        """Return the topics on which it reports."""
        return super().topics | {self._telemetry_topic}

    @property
    def request(self) -> LightCommand | None:
        """Return the message that asks for its state, which it does not retain."""
        return LightCommand(self._request_topic, "")

    def on_message(self, topic: str, payload: bytes) -> None:
        """Note what the light reports, on the topic of answers or of telemetry."""
        super().on_message(topic, payload)
        if topic == self._telemetry_topic:
            self._on_state(payload)

    def _on_state(self, payload: bytes) -> None:
        report = mapping(json_value(payload))
        power = report.get(self._power, report.get(f"{self._power}1"))
        if power == self._on:
            self._is_on = True
        elif power == self._off:
            self._is_on = False
        level = report.get("Dimmer")
        if level is not None:
            self._on_level(str(level))


def _topic_of(device: dict[str, Any], prefix: str) -> str:
    """Return the begin of the topics of a device with `prefix`, such as `cmnd/desk/`."""
    mac = text(device.get("mac"))
    parts = {
        "%prefix%": prefix,
        "%topic%": text(device.get("t")),
        "%hostname%": text(device.get("hn")),
        "%id%": mac[-6:],
    }
    topic = text(device.get("ft")) or "%prefix%/%topic%/"
    for placeholder, value in parts.items():
        topic = topic.replace(placeholder, value)
    return topic
