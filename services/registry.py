"""Process table: all processes including bridges, their topics and requests.

`pointit list`, the scenarios and the architecture tests use it. Modules are named, not imported, so that a
process loads only what it needs. Services of other packages get a row when they are named, or all at once.
"""

import contextlib
import functools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from pointit.runtime.config.installed import installed_entry_points
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import import_room, remedy
from pointit.schemas import topics
from pointit.schemas.system import split_instance
from pointit.schemas.topics import Presence, Request, Topic

if TYPE_CHECKING:
    from pointit.services.service_plugin import ServicePlugin


SHOWN: tuple[topics.Topic[Any], ...] = (
    topics.PROFILE, topics.POSE, topics.LOCALIZATION, topics.CURSOR, topics.HOVER,
    topics.ANNOUNCED, topics.INTERACTION, topics.FEEDBACK, topics.GOAL, topics.STEERING, topics.UNDERSTOOD,
    topics.MAP, topics.OBJECTS, topics.ROBOT_STATE, topics.ROBOT_PLAN, topics.SELECTION, topics.MANNER,
    topics.SELECTION_EVENTS, topics.OUTCOMES, topics.THING_STATES, topics.LAMP_COLOR, topics.STRIPS_FRAME,
    topics.CONVEYOR_STATE, topics.HEALTH, topics.DEPLOYMENT,
)  # fmt: skip
"""Everything but raw IMU samples and rays."""

IMU_BRIDGE = "imu-bridge"
"""The process of a person's own device, or of a page's mouse or phone."""

RECORDER = "recorder"
"""The process that records a site. Only an identity that may read everything records everything."""

GROUP = "pointit.services"
"""Group of the entry points of services of other packages."""


@dataclass(frozen=True, kw_only=True)
class Process:
    """A row of the table."""

    name: str
    scope: Literal["site", "user"]
    """One instance per site, or one per person."""
    several: bool = False
    """True if several may run on a site, each under a name: `robot.quad`."""
    shard_serves: tuple[Request[Any, Any], ...] | None = None
    """Requests that shards answer, if those with a name are shards: they serve some of the people each. None
    if there are no shards."""
    about: str
    reads: tuple[Topic[Any], ...]
    writes: tuple[Topic[Any], ...]
    serves: tuple[Request[Any, Any], ...] = ()
    announces: tuple[Presence, ...] = ()
    """Presences that it announces besides its own."""
    room: Literal["services", "bridges"] = "services"
    """Room of its package."""
    extra: str = ""
    """Extra of the distribution, if it needs more than the base."""
    plugin: "ServicePlugin | None" = None
    """The plug-in of another package, if it is one."""
    label: str = ""
    """Name of the plug-in and its package in messages, or `""` if it is ours."""

    @property
    def command(self) -> tuple[str, ...]:
        """Return the arguments with which Python runs it as a process."""
        return "-m", "pointit.services", self.name

    @property
    def package(self) -> str:
        """Return the name of its package."""
        return f"pointit.{self.room}.{self.name.replace('-', '_')}"

    def config(self) -> Any:
        """Return the class of its parameters, which needs no extra: `LedDriverConfig` for `led-driver`."""
        if self.plugin is not None:
            return self.plugin.config
        try:
            module = import_room(f"{self.package}.config", self.name)
        except ConfigError:  # a short one stands in the service
            return self.load().CONFIG
        return getattr(module, f"{self.name.title().replace('-', '')}Config")

    def load(self) -> Any:
        """Return its service class.

        Raises:
            ConfigError: If it needs an extra that is not installed.
        """
        if self.plugin is not None:
            return self.plugin.make
        try:
            return import_room(f"{self.package}.service", self.name).SERVICE
        except ImportError as error:
            package, _, _ = (error.name or "").partition(".")
            if not self.extra or package == "pointit":
                raise  # not a missing extra but a bug of ours
            raise ConfigError(f"{self.name} needs {remedy(self.extra)}") from error


# tables: each row takes as few lines as it needs
# fmt: off
HOME_ASSISTANT = Process(
    name="home-assistant", scope="site", room="bridges", extra="home-assistant",
    about="things that are entities of a Home Assistant: actions there, and their state back",
    reads=(
        topics.MAP, topics.HOVER, topics.SELECTION_EVENTS, topics.ANNOUNCED, topics.RAY, topics.IMU,
        topics.BUTTON,
    ),
    writes=(topics.THING_STATES, topics.ACT_RESULTS),
    serves=(topics.SET_UP_HOME,),
)
PROCESSES: list[Process] = [
    Process(
        name="imu-bridge", scope="user",
        about="a wrist's IMU: serial device, recording, simulated movement, or a page's mouse or phone",
        reads=(topics.WRIST, topics.FEEDBACK),
        writes=(topics.IMU, topics.BUTTON, topics.STEP),
        serves=(topics.SET_YAW_ORIGIN, topics.SET_MOUNTING),
    ),
    Process(
        name="pointing", scope="user",
        about="arm orientation and body measures to the pointing ray, filtered and corrected",
        reads=(topics.IMU, topics.PROFILE, topics.POSE),
        writes=(topics.RAY,),
    ),
    Process(
        name="localizer", scope="user",
        about="position of the person: fixed, by pointing at lamps, or at a moving robot",
        reads=(
            topics.RAY, topics.IMU, topics.MAP, topics.OBJECTS, topics.ROBOT_STATE, topics.LAMP_LEASES,
            topics.POSE, topics.INTERACTION, topics.ANNOUNCED, topics.SELECTION_EVENTS,
        ),
        writes=(topics.POSE, topics.LOCALIZATION, topics.ANCHOR),
        serves=(
            topics.START_LOCALIZATION, topics.CANCEL_LOCALIZATION, topics.SET_POSE, topics.SET_HEADING,
            topics.POINT_ANCHOR,
        ),
    ),
    Process(
        name="supervisor", scope="user",
        about="the interaction's life cycle; owns the profile",
        reads=(
            topics.BUTTON, topics.IMU, topics.LOCALIZATION, topics.POSE, topics.INTERACTION, topics.MANNER,
            topics.ANNOUNCED,
        ),
        writes=(topics.PROFILE, topics.INTERACTION, topics.FEEDBACK),
        serves=(topics.SET_OFFSET, topics.SAY),
    ),
    Process(
        name="goal", scope="user",
        about="pointing at robots and places to steering and goals for a robot",
        reads=(
            topics.CURSOR, topics.RAY, topics.POSE, topics.INTERACTION, topics.BUTTON, topics.MAP,
            topics.ROBOT_STATE,
        ),
        writes=(topics.GOAL, topics.STEERING, topics.FEEDBACK),
        serves=(topics.SEND_ROBOT,),
    ),
    Process(
        name="listener", scope="user",
        about="the last ten seconds of a person's pointing, and what they mean by a word",
        reads=(topics.CURSOR, topics.POSE, topics.OBJECTS, topics.ROBOT_STATE, topics.MAP, topics.SPEECH),
        writes=(),
        serves=(topics.FIND_REFERENTS,),
    ),
    Process(
        name="speaker", scope="site", room="bridges",
        about="names that are announced, spoken by the loudspeaker of this machine",
        reads=(topics.ANNOUNCED,), writes=(),
    ),
    Process(
        name="user-sim", scope="user",
        about="a simulated person who sees lights, reaches for targets and holds",
        reads=(
            topics.MAP, topics.OBJECTS, topics.ROBOT_STATE, topics.STRIPS_FRAME, topics.LAMP_COLOR,
            topics.FEEDBACK, topics.PROFILE, topics.WRIST, topics.ANNOUNCED,
        ),
        writes=(topics.IMU, topics.BUTTON),
    ),
    Process(
        name="pui", scope="site", several=True, shard_serves=(topics.SET_WORKSPACE,),
        about="rays, poses and the map to cursors",
        reads=(topics.RAY, topics.POSE, topics.INTERACTION, topics.OBJECTS, topics.MAP),
        writes=(topics.MAP, topics.CURSOR, topics.FEEDBACK, topics.OBJECTS),
        serves=(topics.SET_WORKSPACE, topics.SET_TOLERANCE, topics.USE_MAP),
    ),
    Process(
        name="selector", scope="site", several=True, shard_serves=(),
        about="cursors that rest on objects to selections",
        reads=(
            topics.CURSOR, topics.OBJECTS, topics.CONVEYOR_STATE, topics.SELECTION_EVENTS, topics.MAP,
            topics.BUTTON, topics.STEP, topics.CLAIM, topics.SELECTION, topics.THING_STATES,
            topics.ACT_RESULTS,
        ),
        writes=(
            topics.HOVER, topics.ANNOUNCED, topics.SELECTION, topics.MANNER, topics.SELECTION_EVENTS,
            topics.FEEDBACK, topics.CLAIM, topics.OUTCOMES,
        ),
        serves=(
            topics.CLEAR_SELECTION, topics.UNDO_SELECTION, topics.RELEASE_OBJECT, topics.SET_THING,
            topics.BEGIN_ACT,
            topics.SET_METHOD, topics.READ_HISTORY,
        ),
    ),
    Process(
        name="reactions", scope="site",
        about="programs and webhooks that act when people point at things",
        reads=(topics.MAP, topics.SELECTION_EVENTS),
        writes=(topics.THING_STATES, topics.ACT_RESULTS),
    ),
    Process(
        name="led-driver", scope="site",
        about="cursors, objects and selections to the light of strips and lamps; who may use which lamp",
        reads=(
            topics.MAP, topics.CURSOR, topics.OBJECTS, topics.HOVER, topics.SELECTION, topics.PROFILE,
            topics.LOCALIZATION, topics.FEEDBACK,
        ),
        writes=(topics.STRIPS_FRAME, topics.LAMP_COLOR, topics.LAMP_LEASES),
        serves=(topics.SET_BRIGHTNESS, topics.SET_LAMP, topics.SHOW_PIXELS),
    ),
    Process(
        name="conveyor-sim", scope="site",
        about="objects that move on belts, or on strips taken as belts",
        reads=(topics.MAP, topics.SELECTION, topics.SELECTION_EVENTS),
        writes=(
            topics.OBJECTS, topics.CONVEYOR_STATE, topics.SELECTION_EVENTS, topics.THING_STATES,
            topics.ACT_RESULTS,
        ),
        serves=(topics.ADD_PACKAGE, topics.SET_SPEED, topics.SET_FEEDING, topics.RESET_CONVEYOR),
    ),
    Process(
        name="robot-replay", scope="site",
        about="the robot of a recording, as a tracker would report it",
        reads=(),
        writes=(topics.OBJECTS,),
    ),
    Process(
        name="mocap", scope="site", room="bridges",
        about="bodies of motion capture as tracked objects, poses of people, or ground truth",
        reads=(topics.MAP, topics.IMU, topics.POSE),
        writes=(topics.OBJECTS, topics.POSE),
    ),
    Process(
        name="agv-tracker", scope="site", room="bridges", extra="mqtt",
        about="AGVs that others steer, from a broker by VDA 5050, as tracked objects",
        reads=(topics.MAP,),
        writes=(topics.OBJECTS,),
    ),
    Process(
        name="robot", scope="site", several=True,
        about="one robot that people steer: simulated, or a driver's",
        reads=(
            topics.STEERING, topics.GOAL, topics.CURSOR, topics.INTERACTION, topics.POSE, topics.MAP,
            topics.ROBOT_STATE, topics.LOCALIZATION,
        ),
        writes=(topics.OBJECTS, topics.ROBOT_STATE, topics.ROBOT_PLAN),
        serves=(topics.STOP_ROBOT,),
    ),
    Process(
        name="keeper", scope="site",
        about="the newest of every state, for late subscribers when its writer is gone; whose clock is apart",
        reads=(
            topics.PROFILE, topics.POSE, topics.LOCALIZATION, topics.INTERACTION, topics.STEERING, topics.MAP,
            topics.ROBOT_PLAN, topics.SELECTION, topics.MANNER, topics.THING_STATES, topics.ANNOUNCED,
            topics.LAMP_COLOR, topics.CONVEYOR_STATE, topics.DEPLOYMENT, topics.HEALTH,
        ),
        writes=(),
    ),
    Process(
        name=RECORDER, scope="site", extra="record",
        about="everything that travels on the site, in a file",
        reads=tuple(topics.TOPICS),
        writes=(),
    ),
    Process(
        name="web", scope="site", room="bridges", extra="web",
        about="a page in browsers: the scene, controls, health; a mouse, phone or headset as a wrist",
        reads=SHOWN,
        writes=(topics.WRIST, topics.BUTTON, topics.STEP, topics.SPEECH, topics.POSE),
    ),
    Process(
        name="foxglove", scope="site", room="bridges", extra="foxglove",
        about="the scene for Foxglove's and Lichtblick's viewer",
        reads=SHOWN,
        writes=(),
    ),
    Process(
        name="ros2", scope="site", room="bridges", extra="ros2",
        about="a node in a ROS 2 graph: every topic under the names and types that robots know, both ways",
        reads=(
            topics.IMU, topics.BUTTON, topics.PROFILE, topics.RAY, topics.POSE, topics.CURSOR, topics.HOVER,
            topics.INTERACTION, topics.GOAL, topics.STEERING, topics.MAP, topics.OBJECTS, topics.ROBOT_STATE,
            topics.ROBOT_PLAN, topics.SELECTION, topics.SELECTION_EVENTS, topics.OUTCOMES, topics.LAMP_COLOR,
            topics.STRIPS_FRAME, topics.CONVEYOR_STATE, topics.CLOCK, topics.HEALTH,
        ),
        writes=(
            topics.WRIST, topics.BUTTON, topics.POSE, topics.CLOCK, topics.RAY, topics.INTERACTION,
            topics.PROFILE, topics.OBJECTS,
        ),
        announces=(topics.USER_ALIVE,),
    ),
    HOME_ASSISTANT,
]
"""All rows: ours, and those of other packages that were added."""
# fmt: on


def person_of(instance: str) -> str:
    """Return the person whose service `instance` is, or `""` if it is a shared one."""
    service, person = split_instance(instance)
    for row in PROCESSES:
        if row.name == service and row.scope == "site":
            return ""
    return person


def moves_arm(service: str) -> bool:
    """Return True if `service`, which may be of another package, is a simulated person with an arm."""
    row = row_of(service) or _row_of_package(service)
    if row is None or service == IMU_BRIDGE:
        return False
    return row.scope == "user" and topics.IMU in row.writes


@functools.lru_cache(maxsize=256)  # presences may have any name
def _row_of_package(service: str) -> Process | None:
    """Return the row of a service of another package, or None if there is none that can be used."""
    with contextlib.suppress(ConfigError, KeyError):
        return process(service)
    return None


def row_of(service: str) -> Process | None:
    """Return the row of a service in the process table, or None."""
    for row in PROCESSES:
        if row.name == service:
            return row
    return None


def present_writers(topic: Topic[Any], name: str, present: Iterable[str]) -> list[str]:
    """Return the instances among `present` that may write `topic` at `name` (`*` or `""`: any)."""
    writers: list[str] = []
    for instance in present:
        if topic in topics.ACCOUNTS:  # each instance writes its own
            may_write = name in (topics.ANY, "", instance)
        else:
            may_write = _may_write(instance, topic, name)
        if may_write:
            writers.append(instance)
    return sorted(writers)


def _may_write(instance: str, topic: Topic[Any], name: str) -> bool:
    """Return True if `instance` may write `topic`, which is not of all services, at `name`."""
    # By its row, or, as a service of another package, by the topic's writers
    service, instance_name = split_instance(instance)
    row = row_of(service)
    is_writer = service in topic.writers
    is_shard = False
    if row is not None:
        is_writer = is_writer or topic in row.writes
        is_shard = bool(instance_name) and row.shard_serves is not None
    if not is_writer:
        return False

    # Shards write topics of people only. The site's instance writes the others
    if is_shard and topic.placeholder != "user":
        return False

    # At its own person or name only, if the topic has a key for each
    own_name = person_of(instance) if topic.placeholder == "user" else instance_name
    if topic.placeholder not in ("user", service) or not own_name:
        return True
    return name in (topics.ANY, "", own_name)


def names() -> list[str]:
    """Return the names of all services, including those of other packages, without importing any."""
    ours = [row.name for row in PROCESSES]
    installed = {entry.name for entry in installed_entry_points(GROUP)}
    return ours + sorted(installed - set(ours))


def with_service_name(instance: str) -> str:
    """Return `instance` with the name of its service: `home-assistant` for `home_assistant`."""
    name, _ = split_instance(instance)
    known = names()
    service = name if name in known else name.replace("_", "-")
    if service not in known:
        return instance
    return service + instance.removeprefix(name)


def sections_by_service(sections: Mapping[str, Any], source: str) -> dict[str, Any]:
    """Return `sections` by the name of their service. Raises ConfigError if one has two, naming `source`."""
    renamed = {with_service_name(section): parameters for section, parameters in sections.items()}
    if len(renamed) < len(sections):
        duplicate = next(section for section in sections if section not in renamed)
        service = with_service_name(duplicate)
        raise ConfigError(f"{source}: {duplicate} and {service} are the same; keep one section")
    return renamed


def process(name: str) -> Process:
    """Return the row called `name`. If it is that of another package, its topics are added to the table.

    Raises:
        KeyError: If there is none. The message lists the existing ones.
        ConfigError: If it is that of another package, which cannot be used.
    """
    known_row = row_of(name)
    if known_row is not None:
        return known_row
    if name not in names():
        raise KeyError(f"no service {name!r}; there are {', '.join(names())}")

    # Its package is imported, once: from now on its row is in the table
    from pointit.services.service_plugin import SERVICES, usable  # noqa: PLC0415 - only if there is one

    plugin = usable(name)
    row = Process(
        name=name,
        scope=plugin.make.SCOPE,
        several=plugin.make.SEVERAL,
        about=plugin.summary,
        reads=plugin.reads,
        writes=plugin.writes,
        serves=plugin.serves,
        plugin=plugin,
        label=SERVICES.label(name),
    )
    PROCESSES.append(row)
    return row


def add_installed() -> None:
    """Add the rows of all services of other packages that can be used. The others are reported if named."""
    for name in names():
        with contextlib.suppress(ConfigError):
            process(name)
