"""Parameters of lamps on an MQTT broker."""

from typing import Annotated, Self

from pydantic import BeforeValidator, Field, StringConstraints, model_validator

from pointit.runtime.address_config import described_error
from pointit.runtime.config.config import Config
from pointit.runtime.mqtt.broker_config import BrokerConfig
from pointit.runtime.mqtt.payload_words import is_online
from pointit.services.led_driver.output.mqtt.light_protocol import WORDS
from pointit.services.led_driver.outputs import OutputConfig

LAMP = "{lamp}"
"""Placeholder of a lamp's id in `MqttConfig.topic`."""
BRIDGE = "/bridge/state"
"""End of the topic by which a Zigbee2MQTT tells if it is online."""
SET = "/set"
"""End of a command topic of Zigbee2MQTT."""
ZIGBEE = ("zigbee", "z2m")
"""Parts of the name of a base topic of Zigbee2MQTT."""
Topic = Annotated[str, StringConstraints(max_length=1000, pattern=r"^[^#+\x00]*$")]


def _payload(value: object) -> object:
    """Return a word of a device. YAML does not tell which word it read as true."""
    if isinstance(value, bool):
        raise described_error('write the word in quotes as the device sends it, such as "true" or "on"')
    return str(value) if isinstance(value, int | float) else value


Payload = Annotated[str, BeforeValidator(_payload), StringConstraints(max_length=200)]


class AvailabilityConfig(Config):
    """Topic and words by which lamps tell if they are online."""

    availability: Topic = Field(
        default="",
        description="topic that tells online or offline; {lamp} stands for the id; /availability in place of "
        "/set if empty",
    )
    payload_available: Payload = Field(
        default="",
        description="word there for online, if PointIt does not know it (`pointit doctor` says so)",
    )
    payload_not_available: Payload = Field(default="", description="word there for offline, likewise")


class LampTopics(AvailabilityConfig):
    """Topics of one lamp."""

    topic: Topic = Field(default="", description="topic of its commands; by `topic` of the output if empty")


class MqttConfig(AvailabilityConfig, BrokerConfig, OutputConfig):
    """Lamps of the map as smart lamps on an MQTT broker (Zigbee2MQTT, Home Assistant's JSON schema)."""

    kind: str = Field(default="mqtt", description="kind of controller")
    topic: Topic = Field(
        default="zigbee2mqtt/{lamp}/set", description="topic of a lamp's commands; {lamp} stands for its id"
    )
    lamps: dict[str, LampTopics] = Field(
        default={}, description="topics by id of the lamp; all lamps of the map, by `topic`, if empty"
    )
    lamp_rate_hz: float = Field(
        default=5.0, gt=0, le=100, description="maximum number of commands per second to a lamp"
    )
    max_rate_hz: float = Field(
        default=20.0, gt=0, le=1000, description="maximum number of commands per second to all lamps"
    )
    status_topic: Topic = Field(
        default="pointit/status",
        description="topic that tells if the lamps are controlled, online or offline; none if empty",
    )
    last_wills: bool = Field(
        default=True,
        description="switch lamps off if PointIt dies: by last wills, for which each has a connection",
    )

    @model_validator(mode="after")
    def _one_topic_a_lamp(self) -> Self:
        if LAMP not in self.topic and not (self.lamps and all(each.topic for each in self.lamps.values())):
            raise ValueError(f"topic: write {LAMP}, for which a lamp's id is put in")
        taken: dict[str, str] = {}
        for lamp_id in self.lamps:
            other = taken.setdefault(self.command_topic(lamp_id), lamp_id)
            if other != lamp_id:
                raise ValueError(f"lamps: {other} and {lamp_id} share a topic")
        return self

    def command_topic(self, lamp_id: str) -> str:
        """Return the topic of a lamp's commands, or `""` if the lamp is not on this output."""
        if self.lamps and lamp_id not in self.lamps:
            return ""
        own = self.lamps[lamp_id].topic if self.lamps else ""
        return own or self.topic.replace(LAMP, lamp_id)

    def availability_topics(self, lamp_id: str) -> tuple[str, ...]:
        """Return the topics that tell if a lamp is online: all of them must say so, or nothing.

        Of those of bridges, the first on which there is anything counts: the lamp is at that one.
        """
        if own := self._of_lamp(lamp_id, "availability"):
            return (own.replace(LAMP, lamp_id),)
        topic = self.command_topic(lamp_id)
        if not topic.endswith(SET) or topic.count("/") < 2:
            return ()
        return (f"{topic.removesuffix(SET)}/availability", *(f"{base}{BRIDGE}" for base in _bases(topic)))

    def is_online(self, lamp_id: str, topic: str, payload: bytes) -> bool | None:
        """Return True if a message on an availability topic says that the lamp is online, None if neither."""
        if topic.endswith(BRIDGE) and not self._of_lamp(lamp_id, "availability"):
            return is_online(payload)
        words = (self._of_lamp(lamp_id, name) for name in WORDS)
        return is_online(payload, *words)

    def _of_lamp(self, lamp_id: str, name: str) -> str:
        """Return the value of the field `name` of a lamp, or that of the output if the lamp has none."""
        own = getattr(self.lamps[lamp_id], name) if lamp_id in self.lamps else ""
        return own or getattr(self, name)


def _bases(topic: str) -> list[str]:
    """Return the possible base topics of Zigbee2MQTT in a lamp's topic, the longest first.

    Names of lamps have slashes, too.
    """
    levels = topic.removesuffix(SET).split("/")[:-1]
    named = [any(word in level.casefold() for word in ZIGBEE) for level in levels]
    first = named.index(True) if any(named) else 0
    return ["/".join(levels[:end]) for end in range(len(levels), first, -1)]
