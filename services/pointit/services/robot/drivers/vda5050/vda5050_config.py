"""Parameters of the driver of AGVs by VDA 5050."""

from typing import Annotated

from pydantic import Field, StringConstraints

from pointit.runtime.mqtt.broker_config import BrokerConfig
from pointit.services.robot.drivers.vda5050.master_messages import Version

TopicLevel = Annotated[str, StringConstraints(max_length=200, pattern=r"^[^/#+\x00]*$")]


class Vda5050Config(BrokerConfig):
    """One AGV on an MQTT broker."""

    manufacturer: TopicLevel = Field(default="", description="manufacturer of the AGV, as in its topics")
    serial_number: TopicLevel = Field(default="", description="serial number of the AGV, as in its topics")
    interface: TopicLevel = Field(default="uagv", description="first level of the topics")
    topic_prefix: str = Field(
        default="",
        max_length=200,
        pattern=r"^[^#+\x00]*$",
        description="levels of the topics before the manufacturer, such as hall/uagv/2.0; interface and "
        "major version if empty",
    )
    version: Version = Field(default="2.0.0", description="version of VDA 5050 that the AGV understands")
    map_id: str = Field(
        default="",
        max_length=200,
        description="map of the AGV in which its positions count; the one that it is on if empty",
    )
    base_m: float = Field(
        default=1.0,
        ge=0.2,
        le=100,
        description="length of the way ahead that is released, and driven also without a connection, m",
    )
    max_order_rate_hz: float = Field(
        default=2.0,
        gt=0,
        le=20,
        description="maximum number of orders and updates per second, since an AGV plans again at each",
    )
