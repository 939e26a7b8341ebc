"""AGVs at a broker: where each of them is. Pure; time is an argument."""

import math
from dataclasses import dataclass, field

from pointit.bridges.agv_tracker.config import AgvTrackerConfig
from pointit.schemas import NS_PER_S, TrackedObject
from pointit.schemas.message_age import SenderClock
from pointit.schemas.text import first_problem
from pointit.vda5050 import (
    LOST_CONNECTIONS,
    AgvConnection,
    AgvTopic,
    TimestampCheck,
    UnreadableFields,
    Visualization,
    agv_of_topic,
    parse,
)

MAX_AGVS = 500
"""Limit of AGVs."""
MAX_AGV_AGE_S = 35.0
"""Age of the newest message from which an AGV has left, s. By the standard it sends one every 30 s."""
MAX_MOVING_AGV_AGE_S = 2.0
"""The same while it drives."""
MAX_ID = 64
"""Maximum length of an id."""
MOVING_MPS = 0.01
"""A slower AGV stands, m/s."""


@dataclass
class _Agv:
    """An AGV, and its newest place."""

    prefix: str
    """Levels of its topics before the manufacturer. Some AGVs report by two versions: the first counts."""
    timestamps: dict[str, TimestampCheck] = field(default_factory=dict[str, TimestampCheck])
    """By kind of message, as the two below."""
    unreadable: dict[str, UnreadableFields] = field(default_factory=dict[str, UnreadableFields])
    problems: dict[str, str] = field(default_factory=dict[str, str])
    """Sentences about its messages."""
    place: tuple[float, float] | None = None
    """On its map, m. None if it is not known."""
    velocity: tuple[float, float] = (0.0, 0.0)
    yaw_rad: float | None = 0.0
    sigma_m: float | None = None
    received_ns: int = 0
    """Time at which the newest place was reported, Unix ns."""
    clock: SenderClock = field(default_factory=lambda: SenderClock(round(MAX_AGV_AGE_S * NS_PER_S)))


class Fleet:
    """The newest place of each AGV."""

    def __init__(self, config: AgvTrackerConfig) -> None:
        self._config = config
        self._left_out = frozenset(config.leave_out)
        self._agvs: dict[str, _Agv] = {}

    @property
    def problem(self) -> str:
        """Return a sentence if messages or fields cannot be read, else `""`."""
        problems: list[str] = []
        for agv in self._agvs.values():
            problems += filter(None, agv.problems.values())
        return first_problem(problems)

    def on_message(self, topic: str, payload: object, now_ns: int, *, is_retained: bool = False) -> bool:
        """Use a message of the broker, as far as it can be read and is not old.

        Return False if it is not from an AGV.
        """
        source = agv_of_topic(topic, self._config.topic_prefix)
        if source is None:
            return False
        kind = source.kind
        models: dict[str, type[AgvConnection | Visualization]] = {"connection": AgvConnection}
        message = parse(models.get(kind, Visualization), payload)
        agv = self._agv_of(source)
        if agv is None or agv.prefix != source.prefix:
            return message is not None

        # Any message shows that the AGV is there, even one without a place
        if agv.place is None:
            agv.received_ns = now_ns
        if message is None:
            agv.problems[kind] = f"{topic[:200]}: a message is not one of VDA 5050: update the AGV"
            return False
        unreadable = agv.unreadable.setdefault(kind, UnreadableFields())
        agv.problems[kind] = unreadable.describe(topic, message)
        if isinstance(message, AgvConnection):
            _on_connection(agv, message)
            return True
        # an AGV that is off has a place that its broker retains
        age_ns = agv.clock.age_ns(message.stamp_ns, now_ns, is_retained=is_retained)
        if age_ns > MAX_AGV_AGE_S * NS_PER_S:
            return True
        timestamps = agv.timestamps.setdefault(kind, TimestampCheck())
        if timestamps.is_new(message.timestamp):
            self._update_place(agv, message, topic, now_ns - round(age_ns))
        return True

    def objects(self, now_ns: int) -> tuple[TrackedObject, ...]:
        """Return where the AGVs are at `now_ns`, on their map, those that drive as far as they have come."""
        objects: list[TrackedObject] = []
        for name, agv in sorted(self._agvs.items()):
            age_s = _age_s(agv, now_ns)
            if age_s > MAX_AGV_AGE_S:
                del self._agvs[name]
                continue

            # one that drove may be anywhere by now
            is_moving = math.hypot(*agv.velocity) > MOVING_MPS
            is_lost = is_moving and age_s > MAX_MOVING_AGV_AGE_S
            if agv.place is not None and not is_lost:
                objects.append(self._tracked_object(name, agv, agv.place, now_ns))
        return tuple(objects)

    def forget(self) -> None:
        """Forget all of them, since the broker is not connected."""
        self._agvs.clear()

    def _agv_of(self, source: AgvTopic) -> _Agv | None:
        """Return the sender of a message, or None if it is not shown."""
        name = source.name
        if name in self._agvs:
            return self._agvs[name]
        if name in self._left_out or len(self._agvs) >= MAX_AGVS:
            return None
        agv = _Agv(source.prefix)
        self._agvs[name] = agv
        return agv

    def _update_place(self, agv: _Agv, message: Visualization, topic: str, reported_ns: int) -> None:
        position = message.agv_position
        if position is not None or not message.unreadable:
            agv.received_ns = reported_ns
        if position is None:
            return

        # A place on another map, or before the AGV has found itself, is none
        agv.problems["map"] = ""
        if self._config.map_id and not position.map_id:
            agv.problems["map"] = (
                f"{topic[:200]}: mapId is missing: set it at the AGV, or leave `map_id` empty"
            )
        if position.position_initialized is False or self._config.map_id not in ("", position.map_id):
            agv.place = None
            return
        agv.velocity = message.velocity_mps
        agv.place = (position.x, position.y)
        agv.yaw_rad = position.theta
        agv.sigma_m = position.deviation_range

    def _tracked_object(self, name: str, agv: _Agv, place: tuple[float, float], now_ns: int) -> TrackedObject:
        x_mps, y_mps = agv.velocity
        is_moving = math.hypot(x_mps, y_mps) > MOVING_MPS
        age_s = max(0.0, _age_s(agv, now_ns)) if is_moving else 0.0
        x_m = place[0] + x_mps * age_s
        y_m = place[1] + y_mps * age_s
        return TrackedObject(
            id=name.replace("/", "-")[:MAX_ID],
            kind="robot",
            position_m=(x_m, y_m, 0.0),
            velocity_mps=(x_mps, y_mps, 0.0),
            length_m=self._config.length_m,
            yaw_rad=agv.yaw_rad,
            position_sigma_m=agv.sigma_m,
        )


def _on_connection(agv: _Agv, message: AgvConnection) -> None:
    agv.timestamps.clear()
    if message.connection_state in LOST_CONNECTIONS:
        agv.place = None
        agv.clock.end(message.stamp_ns)
        return
    agv.clock.start()


def _age_s(agv: _Agv, now_ns: int) -> float:
    return (now_ns - agv.received_ns) / NS_PER_S
