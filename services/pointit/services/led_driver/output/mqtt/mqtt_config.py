"""Parameters of lamps on an MQTT broker."""

from typing import Annotated, Self

from pydantic import Field, StringConstraints, model_validator

from pointit.runtime.config.config import Config
from pointit.runtime.mqtt.broker_config import BrokerConfig
from pointit.services.led_driver.outputs import OutputConfig

LAMP = "{lamp}"
"""Placeholder of a lamp's id in `MqttConfig.topic`."""
SET = "/set"
"""End of a command topic of Zigbee2MQTT."""
Topic = Annotated[str, StringConstraints(max_length=1000, pattern=r"^[^#+\x00]*$")]


class LampTopics(Config):
    """Topics of one lamp."""

    topic: Topic = Field(default="", description="topic of its commands; by `topic` of the output if empty")
    availability: Topic = Field(
        default="", description="topic that tells online or offline; /availability in place of /set if empty"
    )


class MqttConfig(BrokerConfig, OutputConfig):
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
        """Return the topics that tell if a lamp is online: all of them must say so, or nothing."""
        if lamp_id in self.lamps and (own := self.lamps[lamp_id].availability):
            return (own,)
        topic = self.command_topic(lamp_id)
        if not topic.endswith(SET) or topic.count("/") < 2:
            return ()
        return (f"{topic.removesuffix(SET)}/availability", f"{topic.partition('/')[0]}/bridge/state")
