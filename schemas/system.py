"""Reports of services: time, health, expected deployment."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from pointit.schemas.base import Count, Id, KeyName, KeyNameError, KeyNameOrEmpty, Many, Message, SchemaModel
from pointit.schemas.problems import OTHER, Problem
from pointit.schemas.table_types import check_name

RUN = "run."
"""Prefix of the name under which a run publishes its deployment. No person may write there."""

SHARDED = frozenset({"pui", "selector"})
"""Shared services whose further instances are shards. Those of one person are called after them."""


SERVICE_USERS = frozenset({"conveyor-sim", "home-assistant", "mqtt", "reactions"})
"""Names under which services change things. The acts of a person of that name would count as theirs."""

DURATION_BOUNDS_S = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""Upper bounds of the buckets of durations, s. 50 ms is the limit of `pointit load` from wrist to light."""

MAX_TITLE = 60
"""Maximum characters of a scenario's title."""

MAX_ABOUT = 200
"""Maximum characters of the sentence on a scenario."""

OWN_SOURCE = "own source"
"""Figure of `imu-bridge`: 1 if the arm has a source besides pages, phones and headsets, 0 if not."""

BODY = "body "
"""Prefix of the figure of a rigid body of motion capture: 1 if it is used, 0 if not."""


def check_user(name: str) -> str:
    """Return `name` if a person may be called so.

    Raises:
        KeyNameError: it cannot stand in a key, or is that of a run or of a service.
    """
    if check_name(name, "user").startswith(RUN):
        raise KeyNameError(
            f"user {name!r}: names that begin with {RUN!r} are those of runs; choose another for a person"
        )
    if name in SERVICE_USERS:
        raise KeyNameError(f"user {name!r}: is the name of a service; choose another for a person")
    return name


def instance_of(service: str, which: str = "") -> str:
    """Return the name under which a service is present: `selector`, `pointing.anna`, `robot.quad`.

    `which`: whose it is, or its name among several of a site.
    """
    return f"{service}.{which}" if which else service


def split_instance(instance: str) -> tuple[str, str]:
    """Return the arguments of `instance_of`: `pointing.anna` is `pointing` of `anna`."""
    service, _, which = instance.partition(".")
    return service, which


def _contradiction(name: str, service: str, instance: str, user: str = "") -> str:
    """Return the first part of an instance's own name that is not that in its key, `name`, or `""`."""
    own_service, owner = split_instance(name)
    if instance != name:
        return f"states the instance {instance}"
    # A router of several adds its host to its name
    if own_service != service and not own_service.startswith(f"{service}-"):
        return f"states the service {service}"
    if user not in ("", owner):
        return f"states the user {user}"
    return ""


class ClockTick(Message):
    """Simulated time: at wall time `stamp_ns` it was `sim_ns`, and it runs `speed` times as fast."""

    sim_ns: Annotated[int, Field(ge=0, le=2**62, description="till 2116: times reckoned from it fit too")]
    speed: Annotated[float, Field(gt=0, le=100)] = 1.0


class KeyHealth(SchemaModel):
    """Traffic of one service on one topic over the last second."""

    key: Id
    direction: Literal["in", "out"]
    rate_hz: Annotated[float, Field(ge=0)]
    age_s: Annotated[float | None, Field(description="since the newest, or None without one")] = None
    dropped: Annotated[int, Field(ge=0, description="conflated or overflowed, since the start")] = 0
    lost: Annotated[int, Field(ge=0, description="events that never arrived, since the start")] = 0
    invalid: Annotated[int, Field(ge=0, description="did not decode or validate, since the start")] = 0


class Quantiles(SchemaModel):
    """Median and 99th percentile, seconds, over the last second, and how the values are distributed."""

    p50_s: float
    p99_s: float
    counts: Annotated[
        Many[Count],
        Field(
            description="number of values in each bucket, up to and with "
            + ", ".join(f"{bound:g}" for bound in DURATION_BOUNDS_S)
            + " s and above; empty if they were not counted"
        ),
    ] = ()
    sum_s: Annotated[float, Field(description="sum of the counted values")] = 0.0


class Figure(SchemaModel):
    """A number of a service's own, such as a drift."""

    name: Annotated[str, Field(min_length=1, max_length=64)]
    value: float
    unit: Annotated[str, Field(max_length=16)] = ""


class Health(Message):
    """One service's own account, once a second."""

    version: ClassVar[int] = 4

    max_bytes: ClassVar[int] = 64 * 1024

    service: KeyName
    instance: KeyName
    pid: Annotated[int, Field(ge=0)]
    host: Id = ""
    user: KeyNameOrEmpty = ""
    uptime_s: Annotated[float, Field(ge=0)] = 0.0
    keys: Many[KeyHealth] = ()
    step: Annotated[Quantiles | None, Field(description="time spent in its handlers")] = None
    latency: Annotated[Quantiles | None, Field(description="from capture to its output")] = None
    errors: Annotated[int, Field(ge=0, description="handlers that raised, since the start")] = 0
    status: Literal["ok", "degraded"] = "ok"
    warnings: Annotated[Many[str], Field(description="sentences of the problems that are warnings")] = ()
    figures: Annotated[Many[Figure], Field(description="further metrics of the service")] = ()
    problems: Annotated[Many[Problem], Field(description="empty if the writer knows none of this field")] = ()

    @property
    def all_problems(self) -> tuple[Problem, ...]:
        """Return the problems, also those of writers that have sentences only."""
        if self.problems:
            return self.problems
        return tuple(Problem(code=OTHER, sentence=warning) for warning in self.warnings)

    def contradiction(self, name: str) -> str:
        """Return the part of its own name that is not that of its key, `name`, or `""`."""
        return _contradiction(name, self.service, self.instance, self.user)


class Configuration(Message):
    """The parameters with which a service has started."""

    max_bytes: ClassVar[int] = 256 * 1024

    service: KeyName
    instance: KeyName
    user: KeyNameOrEmpty = ""
    parameters: Annotated[str, Field(description="JSON of all parameters but secrets")] = "{}"
    release: Annotated[Id, Field(description="version of PointIt")] = ""

    def contradiction(self, name: str) -> str:
        """Return the part of its own name that is not that of its key, `name`, or `""`."""
        return _contradiction(name, self.service, self.instance, self.user)


class ServedRequest(Message):
    """A request that a service has answered; `stamp_ns` is when it got it."""

    max_bytes: ClassVar[int] = 1024 * 1024

    service: KeyName
    instance: KeyName
    request: Annotated[Id, Field(description="key of the request")]
    query: Annotated[str, Field(description="JSON")]
    reply: Annotated[str, Field(description="JSON, or empty if it was refused or too large")] = ""
    refusal: Annotated[str, Field(description="the reason, or empty if it was not refused")] = ""

    def contradiction(self, name: str) -> str:
        """Return the part of its own name that is not that of its key, `name`, or `""`."""
        return _contradiction(name, self.service, self.instance)


class ExpectedService(SchemaModel):
    """A service that should be running, and the command that starts it again."""

    service: KeyName
    user: KeyNameOrEmpty = ""
    command: Many[str] = ()
    name: Annotated[KeyNameOrEmpty, Field(description="among several of its kind on the site, or empty")] = ""

    @property
    def instance(self) -> str:
        """Return the name under which it is present."""
        return instance_of(self.service, self.user or self.name)


class ScenarioOffer(SchemaModel):
    """A scenario that a run accepts in place of the running one, as a menu shows it."""

    name: Id
    title: Annotated[str, Field(max_length=MAX_TITLE, description="in a few words, such as `Lamps`")]
    about: Annotated[str, Field(max_length=MAX_ABOUT, description="what happens there, in one sentence")] = ""
    is_shipped: Annotated[
        bool, Field(description="comes with PointIt: `pointit run` takes its name, not a path")
    ] = False


class Deployment(Message):
    """Services started by `pointit run` or `pointit person add`, by which `doctor` finds missing ones."""

    version: ClassVar[int] = 6

    max_bytes: ClassVar[int] = 512 * 1024
    """Room for 64 people."""

    name: Annotated[Id, Field(description="the scenario, or the user")]
    services: Many[ExpectedService] = ()
    scenario: Annotated[Id, Field(description="name of the running one, or empty if it has none")] = ""
    scenarios: Annotated[
        Many[Id], Field(description="alternatives on request; empty if it accepts none")
    ] = ()
    localizes: Annotated[bool, Field(description="people are found by pointing at lamps")] = False
    target_kinds: Annotated[
        Many[Id], Field(description="kinds of objects to select; empty if all are right")
    ] = ()
    goal: Annotated[
        str,
        Field(max_length=200, description="instruction to a newcomer who points, in one sentence, or empty"),
    ] = ""
    title: Annotated[str, Field(max_length=MAX_TITLE, description="of the running scenario")] = ""
    offers: Annotated[Many[ScenarioOffer], Field(description="those of `scenarios`, for a menu")] = ()

    def believed(self, name: str) -> "Deployment":
        """Return the part that the writer of `deployment/{name}` may state: a run all, a person their own.

        That are their services, and shards called after them, not `robot.quad` of a person called quad.

        The router enforces write access. The content of a message is only its writer's claim.
        """
        if name.startswith(RUN):
            return self
        own: list[ExpectedService] = []
        for service in self.services:
            is_shard = service.name == name and service.service in SHARDED
            if service.user == name or (is_shard and not service.user):
                own.append(service)

        # All else describes the run, of which a person's process may claim nothing
        claims = {
            "services": tuple(own),
            "scenario": "",
            "scenarios": (),
            "localizes": False,
            "target_kinds": (),
            "goal": "",
            "title": "",
            "offers": (),
            "name": name,
        }
        return self.model_copy(update=claims)
