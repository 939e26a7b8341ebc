"""Parameters of agv-tracker."""

from typing import Annotated

from pydantic import Field, StringConstraints

from pointit.runtime.mqtt.broker_config import BrokerConfig
from pointit.schemas.base import Name

AgvName = Annotated[str, StringConstraints(max_length=200, pattern=r"^[^/]+/[^/]+$")]


class AgvTrackerConfig(BrokerConfig):
    """A broker, and what of its AGVs is shown."""

    tracker: Name = Field(default="agvs", description="name of the tracker, unique on the site")
    topic_prefix: str = Field(
        default="",
        max_length=200,
        pattern=r"^[^#+\x00]*[^#+\x00/]$|^$",
        description="levels of the topics before the manufacturer, such as hall/uagv/2.0; if empty, any "
        "interface and major version, such as uagv/v2",
    )
    frame: str = Field(
        default="", description="frame of the map in which the AGVs tell their places; empty for {W}"
    )
    map_id: str = Field(
        default="", max_length=200, description="map of the AGVs that counts; every one if empty"
    )
    length_m: float = Field(default=1.0, gt=0, le=20, description="diameter of an AGV, m")
    leave_out: tuple[AgvName, ...] = Field(
        default=(),
        max_length=500,
        description="AGVs that are not shown, MANUFACTURER/SERIAL_NUMBER, such as those that are robots here",
    )
