"""AGVs at a broker: where each of them is. Pure; time is an argument."""

import math
from dataclasses import dataclass, field

from pointit.bridges.agv_tracker.config import AgvTrackerConfig
from pointit.schemas import NS_PER_S, TrackedObject
from pointit.vda5050.agv_messages import (
    Connection,
    HeaderCheck,
    LastPose,
    State,
    Visualization,
    parse,
    velocity_on_map,
)

TOPICS = ("+/+/+/+/connection", "+/+/+/+/state", "+/+/+/+/visualization")
LEVELS = 5
"""Number of levels of a topic."""
MAX_AGVS = 500
"""Limit of AGVs."""
SILENT_S = 35.0
"""Time without a message after which an AGV has left, s. By the standard it sends one every 30 s."""
MOVING_S = 2.0
"""The same while it drives."""
MAX_ID = 64
"""Maximum length of an id."""
MOVING_MPS = 0.01
"""A slower AGV stands, m/s."""


@dataclass
class _Agv:
    """An AGV, and its newest place."""

    headers: dict[str, HeaderCheck] = field(default_factory=dict[str, HeaderCheck])
    place: tuple[float, float] | None = None
    """On its map, m. None if it is not known."""
    velocity: tuple[float, float] = (0.0, 0.0)
    yaw_rad: float = 0.0
    sigma_m: float | None = None
    heard_ns: int = 0


class Fleet:
    """The newest place of each AGV."""

    def __init__(self, config: AgvTrackerConfig) -> None:
        self._config = config
        self._left_out = frozenset(config.leave_out)
        self._agvs: dict[str, _Agv] = {}

    def on_message(self, topic: str, payload: object, now_ns: int) -> bool:
        """Take a message of the broker. Return False if it is none of an AGV."""
        levels = topic.split("/")
        if len(levels) != LEVELS:
            return False
        name, kind = "/".join(levels[2:4]), levels[4]
        message = (
            parse(Connection, payload)
            if kind == "connection"
            else parse(State, payload)
            if kind == "state"
            else parse(Visualization, payload)
        )
        if message is None:
            return False
        if isinstance(message, Connection):
            if agv := self._agvs.get(name):
                agv.headers.clear()
                if message.connection_state != "ONLINE":
                    agv.place = None
        elif name not in self._left_out and (name in self._agvs or len(self._agvs) < MAX_AGVS):
            agv = self._agvs.setdefault(name, _Agv())
            if agv.headers.setdefault(kind, HeaderCheck()).is_new(message.header_id):
                self._place(agv, message, now_ns)
        return True

    def objects(self, now_ns: int) -> tuple[TrackedObject, ...]:
        """Return where the AGVs are at `now_ns`, on their map, those that drive as far as they have come."""
        for name in [name for name, agv in self._agvs.items() if _age_s(agv, now_ns) > SILENT_S]:
            del self._agvs[name]
        return tuple(
            self._object(name, agv, agv.place, now_ns)
            for name, agv in sorted(self._agvs.items())
            if agv.place is not None
            and not (math.hypot(*agv.velocity) > MOVING_MPS and _age_s(agv, now_ns) > MOVING_S)
        )

    def forget(self) -> None:
        """Forget all of them, since the broker is not connected."""
        self._agvs.clear()

    def _place(self, agv: _Agv, message: Visualization, now_ns: int) -> None:
        last = LastPose(agv.place, agv.velocity, _age_s(agv, now_ns)) if agv.place else None
        agv.heard_ns = now_ns
        position = message.agv_position
        if position is None:
            return
        if not position.position_initialized or self._config.map_id not in ("", position.map_id):
            agv.place = None
            return
        agv.velocity = velocity_on_map(message, last)
        agv.place = (position.x, position.y)
        agv.yaw_rad, agv.sigma_m = position.theta, position.deviation_range

    def _object(self, name: str, agv: _Agv, place: tuple[float, float], now_ns: int) -> TrackedObject:
        is_moving = math.hypot(*agv.velocity) > MOVING_MPS
        age_s = max(0.0, _age_s(agv, now_ns)) if is_moving else 0.0
        return TrackedObject(
            id=name.replace("/", "-")[:MAX_ID],
            kind="robot",
            position_m=(place[0] + agv.velocity[0] * age_s, place[1] + agv.velocity[1] * age_s, 0.0),
            velocity_mps=(*agv.velocity, 0.0),
            length_m=self._config.length_m,
            yaw_rad=agv.yaw_rad,
            position_sigma_m=agv.sigma_m,
        )


def _age_s(agv: _Agv, now_ns: int) -> float:
    return (now_ns - agv.heard_ns) / NS_PER_S
