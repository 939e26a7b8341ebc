"""THE TOPIC TABLE: every key, its message, how it is delivered, how often, who writes it.

Keys are relative to the site's namespace, `pointit/<site>`. A key has at most one placeholder, in braces.
Nothing else in the code base spells a key: services name the rows of this table.
"""

import re
from dataclasses import dataclass
from enum import Enum
from typing import Any, Generic, TypeVar

from pointit.schemas import environment, person, pointing, requests, selection, system
from pointit.schemas.base import Message, Query, Reply
from pointit.schemas.errors import KeyNameError

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)

ANY = "*"
"""Stands for every name of a placeholder when subscribing."""

STALE_PERIODS = 10
"""A topic is stale when nothing came for this many of its nominal periods."""

_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.\-]{0,63}\Z")
_PLACEHOLDER = re.compile(r"\{(\w+)\}")


class Delivery(Enum):
    """What a writer promises and a reader gets."""

    LATEST = "latest"
    """Newest wins: never queues, never blocks the sender."""
    EVENT = "event"
    """Reliable and ordered; an overflow is counted and reported, never silent."""
    STATE = "state"
    """Reliable; whoever joins late gets the last value at once."""


class _Keyed:
    """A key pattern with at most one placeholder."""

    key: str

    @property
    def placeholder(self) -> str:
        """Return the placeholder's name, `user` of `users/{user}/imu`; empty when there is none."""
        found = _PLACEHOLDER.search(self.key)
        return found.group(1) if found else ""

    def at(self, name: str = "") -> str:
        """Return the key for `name`, or for all names when it is `*`.

        Raises:
            KeyNameError: `name` is missing, not wanted, or cannot stand in a key.
        """
        placeholder = self.placeholder
        if not placeholder:
            if name not in ("", ANY):
                raise KeyNameError(f"{self.key} takes no name, got {name!r}")
            return self.key
        if name != ANY:
            check_name(name, placeholder)
        return self.key.replace("{" + placeholder + "}", name)

    def name_in(self, key: str) -> str:
        """Return what stands for the placeholder in `key`; empty when there is none or it is another key."""
        head, _, tail = self.key.partition("{" + self.placeholder + "}")
        if not self.placeholder or not (key.startswith(head) and key.endswith(tail)):
            return ""
        return key[len(head) : len(key) - len(tail)]


def check_name(name: str, what: str = "name") -> str:
    """Return `name` if it can stand in a key.

    Raises:
        KeyNameError: says which characters may be used.
    """
    if not _NAME.match(name):
        raise KeyNameError(
            f"{what} {name!r}: use 1 to 64 letters, digits, '_', '-' or '.', no leading '-' or '.'"
        )
    return name


@dataclass(frozen=True, kw_only=True)
class Topic(_Keyed, Generic[M]):
    """A row of the table."""

    key: str
    message: type[M]
    delivery: Delivery
    rate_hz: float | None
    """Nominal rate; none where messages come on change."""
    writers: tuple[str, ...]
    """Processes that may write it, as in the registry; `external`: a foreign tracker may too."""
    about: str

    @property
    def stale_after_s(self) -> float | None:
        """Return the age at which the newest message is no longer to be trusted, in seconds."""
        return None if self.rate_hz is None else STALE_PERIODS / self.rate_hz


@dataclass(frozen=True, kw_only=True)
class Request(_Keyed, Generic[Q, R]):
    """Something that can be asked, who answers, and with what."""

    key: str
    query: type[Q]
    reply: type[R]
    server: str
    about: str


@dataclass(frozen=True, kw_only=True)
class Presence(_Keyed):
    """A token that exists exactly as long as its owner."""

    key: str
    about: str


_LATEST, _EVENT, _STATE = Delivery.LATEST, Delivery.EVENT, Delivery.STATE

IMU = Topic(
    key="users/{user}/imu",
    message=person.ImuSample,
    delivery=_LATEST,
    rate_hz=50,
    writers=("imu-bridge", "user-sim"),
    about="orientation of the arm",
)
BUTTON = Topic(
    key="users/{user}/button",
    message=person.ButtonEvent,
    delivery=_EVENT,
    rate_hz=None,
    writers=("imu-bridge", "user-sim", "cli"),
    about="the person's button",
)
PROFILE = Topic(
    key="users/{user}/profile",
    message=person.UserProfile,
    delivery=_STATE,
    rate_hz=None,
    writers=("supervisor",),
    about="body measures, handedness, colour",
)
RAY = Topic(
    key="users/{user}/ray",
    message=pointing.PointingRay,
    delivery=_LATEST,
    rate_hz=50,
    writers=("pointing",),
    about="pointing ray in {H}",
)
POSE = Topic(
    key="users/{user}/pose",
    message=pointing.UserPose,
    delivery=_STATE,
    rate_hz=None,
    writers=("localizer", "external"),
    about="{H} in {W}",
)
LOCALIZATION = Topic(
    key="users/{user}/localization",
    message=pointing.Localization,
    delivery=_STATE,
    rate_hz=None,
    writers=("localizer",),
    about="progress of localizing",
)
CURSOR = Topic(
    key="users/{user}/cursor",
    message=pointing.Cursor,
    delivery=_LATEST,
    rate_hz=50,
    writers=("pui",),
    about="where the ray meets the room",
)
HOVER = Topic(
    key="users/{user}/hover",
    message=pointing.Hover,
    delivery=_LATEST,
    rate_hz=50,
    writers=("selector",),
    about="object under the cursor",
)
INTERACTION = Topic(
    key="users/{user}/interaction",
    message=pointing.Interaction,
    delivery=_STATE,
    rate_hz=None,
    writers=("supervisor",),
    about="life cycle of the interaction",
)
FEEDBACK = Topic(
    key="users/{user}/feedback",
    message=pointing.Feedback,
    delivery=_EVENT,
    rate_hz=None,
    writers=("supervisor", "selector"),
    about="cues: haptic, chime, light",
)
MAP = Topic(
    key="map",
    message=environment.Environment,
    delivery=_STATE,
    rate_hz=None,
    writers=("pui",),
    about="the room",
)
OBJECTS = Topic(
    key="objects",
    message=environment.TrackedObjects,
    delivery=_LATEST,
    rate_hz=25,
    writers=("conveyor-sim", "robot-replay", "external"),
    about="what moves",
)
SELECTION = Topic(
    key="selection",
    message=selection.Selection,
    delivery=_STATE,
    rate_hz=None,
    writers=("selector",),
    about="what is selected",
)
SELECTION_EVENTS = Topic(
    key="selection/events",
    message=selection.SelectionEvent,
    delivery=_EVENT,
    rate_hz=None,
    writers=("selector", "conveyor-sim"),
    about="selected, deselected, left",
)
LAMP_COLOR = Topic(
    key="leds/{led}/color",
    message=environment.LampColor,
    delivery=_STATE,
    rate_hz=None,
    writers=("localizer",),
    about="colour of a single lamp",
)
STRIPS_FRAME = Topic(
    key="strips/frame",
    message=environment.StripsFrame,
    delivery=_LATEST,
    rate_hz=None,
    writers=("led-driver",),
    about="pixels of every strip, at most 60 Hz",
)
CONVEYOR_STATE = Topic(
    key="conveyor/state",
    message=environment.ConveyorState,
    delivery=_STATE,
    rate_hz=None,
    writers=("conveyor-sim",),
    about="speed and counts",
)
CLOCK = Topic(
    key="clock",
    message=system.ClockTick,
    delivery=_STATE,
    rate_hz=None,
    writers=("cli",),
    about="simulated time",
)
HEALTH = Topic(
    key="health/{service}",
    message=system.Health,
    delivery=_LATEST,
    rate_hz=1,
    writers=("every service",),
    about="each service's own account; {service} is its instance",
)
DEPLOYMENT = Topic(
    key="deployment/{name}",
    message=system.Deployment,
    delivery=_STATE,
    rate_hz=None,
    writers=("cli",),
    about="what should be running",
)

TOPICS: tuple[Topic[Any], ...] = (
    IMU,
    BUTTON,
    PROFILE,
    RAY,
    POSE,
    LOCALIZATION,
    CURSOR,
    HOVER,
    INTERACTION,
    FEEDBACK,
    MAP,
    OBJECTS,
    SELECTION,
    SELECTION_EVENTS,
    LAMP_COLOR,
    STRIPS_FRAME,
    CONVEYOR_STATE,
    CLOCK,
    HEALTH,
    DEPLOYMENT,
)

ADD_PACKAGE = Request(
    key="conveyor/add_package",
    query=requests.AddPackage,
    reply=requests.AddPackageReply,
    server="conveyor-sim",
    about="put one object on a lane",
)
SET_SPEED = Request(
    key="conveyor/set_speed",
    query=requests.SetSpeed,
    reply=requests.Done,
    server="conveyor-sim",
    about="set the speed, m/s",
)
RESET_CONVEYOR = Request(
    key="conveyor/reset",
    query=requests.ResetConveyor,
    reply=requests.Done,
    server="conveyor-sim",
    about="empty it and start the feeders again",
)
START_LOCALIZATION = Request(
    key="localizer/{user}/start",
    query=requests.StartLocalization,
    reply=requests.Done,
    server="localizer",
    about="begin to localize",
)
CANCEL_LOCALIZATION = Request(
    key="localizer/{user}/cancel",
    query=requests.CancelLocalization,
    reply=requests.Done,
    server="localizer",
    about="stop localizing",
)
SET_POSE = Request(
    key="localizer/{user}/set_pose",
    query=requests.SetPose,
    reply=requests.Done,
    server="localizer",
    about="say where the person stands",
)
CLEAR_SELECTION = Request(
    key="selector/{user}/clear",
    query=requests.ClearSelection,
    reply=requests.Done,
    server="selector",
    about="deselect all that is the person's",
)
SET_BRIGHTNESS = Request(
    key="leds/brightness",
    query=requests.SetBrightness,
    reply=requests.Done,
    server="led-driver",
    about="dim all strips",
)
SET_YAW_ORIGIN = Request(
    key="imu/{user}/set_yaw_origin",
    query=requests.SetYawOrigin,
    reply=requests.Done,
    server="imu-bridge",
    about="set the IMU's yaw",
)

REQUESTS: tuple[Request[Any, Any], ...] = (
    ADD_PACKAGE,
    SET_SPEED,
    RESET_CONVEYOR,
    START_LOCALIZATION,
    CANCEL_LOCALIZATION,
    SET_POSE,
    CLEAR_SELECTION,
    SET_BRIGHTNESS,
    SET_YAW_ORIGIN,
)

SERVICE_ALIVE = Presence(key="alive/services/{instance}", about="one service instance runs")
USER_ALIVE = Presence(key="alive/users/{user}", about="one person's services run")

PRESENCES: tuple[Presence, ...] = (SERVICE_ALIVE, USER_ALIVE)


def topic_of(key: str) -> Topic[Any] | None:
    """Return the row whose key pattern fits `key` (relative to the site), or none."""
    for topic in TOPICS:
        if not topic.placeholder:
            if topic.key == key:
                return topic
        elif (name := topic.name_in(key)) == ANY or _NAME.match(name):
            return topic
    return None
