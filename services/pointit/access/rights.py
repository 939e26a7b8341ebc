"""Rights of each role, derived from the tables: a new row of a table has its rights automatically."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

from pointit.schemas.system import RUN, instance_of
from pointit.schemas.topics import (
    ACCOUNTS,
    ANY,
    BUTTON,
    CLOCK,
    CONFIGURATION,
    DEPLOYMENT,
    FIND_REFERENTS,
    IMU,
    PRESENCES,
    RAY,
    READ_HISTORY,
    RELEASE_OBJECT,
    REQUESTS,
    RUN_SCENARIO,
    SERVED,
    SERVICE_ALIVE,
    SET_THING,
    SHARD_ALIVE,
    SPEECH,
    STEP,
    STOP_ROBOT,
    TOPICS,
    UNDERSTOOD,
    USE_MAP,
    USER_ALIVE,
    WRIST,
    Delivery,
    Request,
    Topic,
)
from pointit.services.registry import HOME_ASSISTANT, PROCESSES, RECORDER, Process, add_installed

Role = Literal["user", "services", "service", "web", "ros2", "dashboard", "operator", "supervisor", "router"]
"""Role of an identity: a person's services; the shared services; one shared service with the identity's name;
the page's server; the ROS 2 bridge; a viewer; a viewer who may send requests; unlimited; another router."""

ROLES: tuple[Role, ...] = get_args(Role)
INTERNAL: tuple[Topic[Any], ...] = (CONFIGURATION, SERVED)
"""Topics for operators of the site."""
PRIVATE: tuple[Topic[Any], ...] = (IMU, WRIST, RAY, SPEECH)
"""Topics that viewers and other people never get: a person's movements and words."""
WITH_OWN_IDENTITY = (RECORDER, "mocap", HOME_ASSISTANT.name)
"""Shared services that may do more than the others, such as read movements, write poses or switch things. On
a secured site each of them needs an identity of its own: `pointit site service add NAME`."""
RECALLED: tuple[Request[Any, Any], ...] = (READ_HISTORY,)
"""Requests open to all roles: they change nothing, and repeat what all may read."""
OF_PEOPLE: tuple[Request[Any, Any], ...] = (FIND_REFERENTS,)
"""Requests of the person and operators only: what a person means by a word. No bridge offers them."""
OF_OPERATORS: tuple[Request[Any, Any], ...] = (RELEASE_OBJECT, SET_THING, USE_MAP)
"""Requests of operators, the page's too, and the supervisor only: they change what others have or use."""
FOR_ALL = (*RECALLED, STOP_ROBOT)
"""Requests of all roles: who sees a robot may stop it."""
ALL = "**"


def viewer_topics() -> list[Topic[Any]]:
    """Return the topics that viewers may read; the page and Foxglove show `registry.SHOWN` of them."""
    return [topic for topic in TOPICS if topic not in (*PRIVATE, *INTERNAL)]


@dataclass(frozen=True, kw_only=True)
class Rights:
    """Keys below the site's namespace, possibly with `*` for a name or `$*` for its end. Sorted."""

    writes: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
    serves: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()
    keeps: tuple[str, ...] = ()
    """States that it serves after their publishers have gone."""
    announces: tuple[str, ...] = ()
    """Keys of presence."""
    watches: tuple[str, ...] = tuple(presence.at(ANY) for presence in PRESENCES)


def rights_of(role: Role, name: str) -> Rights:
    """Return the rights of the identity `name` in `role`, with those of installed services."""
    add_installed()
    if role in ("supervisor", "router"):
        return Rights(
            writes=(ALL,), reads=(ALL,), serves=(ALL,), asks=(ALL,), announces=(ALL,), watches=(ALL,)
        )
    if role == "user":
        return _user(name)
    if role == "services":
        return _services()
    if role == "service":
        return _service(name)
    if role in ("web", "ros2"):
        return _bridge(role)
    if role == "operator":
        return Rights(reads=_anywhere([viewer_topics(), INTERNAL]), asks=_anywhere([REQUESTS]))
    return Rights(reads=_anywhere([viewer_topics()]), asks=_anywhere([FOR_ALL]))


def _bridge(name: str) -> Rights:
    """Return the rights of the bridge `name`: those of its row, and all requests but those of others only.

    The ROS bridge may be present for any person. Its configuration decides for whom.
    """
    (row,) = (row for row in PROCESSES if row.name == name)
    others = OF_PEOPLE if name == "web" else (*OF_PEOPLE, *OF_OPERATORS)
    return Rights(
        writes=_sorted(
            [*_anywhere([row.writes]), *(key for topic in ACCOUNTS for key in _numbered(topic.at(name)))]
        ),
        reads=_anywhere([viewer_topics(), row.reads]),
        asks=_anywhere([[request for request in REQUESTS if request not in others]]),
        announces=(*_numbered(SERVICE_ALIVE.at(name)), *(presence.at(ANY) for presence in row.announces)),
    )


def _instances(key: str, row: Process) -> tuple[str, ...]:
    """Return the keys of a shared service's instances: one, or those of any name."""
    return _numbered(key) if row.several else (key,)


def _numbered(key: str) -> tuple[str, ...]:
    """Return the key of the first instance, and the pattern of all others, as `web.2`."""
    return (key, f"{key}.$*")


def _user(name: str) -> Rights:
    """Return the rights of the services and shards of the person `name`: they write and answer their keys."""
    mine = _of_scope("user")
    shards = [row for row in PROCESSES if row.shard_serves is not None]
    instances = [instance_of(row.name, name) for row in (*mine, *shards)]
    reads = [topic.at(name) for row in (*mine, *shards) for topic in row.reads if _is_personal(topic)]
    serves = [request for row in mine for request in row.serves if _is_personal(request)]
    return Rights(
        writes=_sorted(
            [
                *(topic.at(name) for row in mine for topic in row.writes),
                *(topic.at(name) for row in shards for topic in row.writes if _is_personal(topic)),
                *(topic.at(name) for topic in (BUTTON, STEP, SPEECH, UNDERSTOOD)),
                *([] if name.startswith(RUN) else [DEPLOYMENT.at(name)]),
                *(topic.at(instance) for topic in ACCOUNTS for instance in instances),
            ]
        ),
        reads=_sorted([*reads, *_anywhere([viewer_topics()])]),
        serves=_sorted(
            request.at(name)
            for request in (*serves, *(each for row in shards for each in row.shard_serves or ()))
        ),
        asks=_sorted(
            [
                *(row.at(name) for row in REQUESTS if _is_personal(row) and row not in OF_OPERATORS),
                *_anywhere([FOR_ALL, (row for row in _asked(mine) if not _is_personal(row))]),
            ]
        ),
        announces=_sorted(
            [
                USER_ALIVE.at(name),
                SERVICE_ALIVE.at(RECORDER),  # nobody records without others seeing it
                *(SERVICE_ALIVE.at(instance) for instance in instances),
                *(SHARD_ALIVE.at(instance_of(row.name, name)) for row in shards),
            ]
        ),
    )


def _service(name: str) -> Rights:
    """Return the rights of the shared service `name`: those of its row, none if it is not installed."""
    rows = [row for row in shared_services() if row.name == name]
    return Rights(
        writes=_sorted([*_anywhere(row.writes for row in rows), *_health_publishers(rows)]),
        reads=_anywhere(row.reads for row in rows),
        serves=_anywhere(row.serves for row in rows),
        asks=_anywhere([FOR_ALL, _asked(rows)]),
        announces=_sorted(
            [*_presences(rows), *(presence.at(ANY) for row in rows for presence in row.announces)]
        ),
    )


def shared_services() -> list[Process]:
    """Return the rows of all services of a site but the bridges that have a role of their own."""
    return [row for row in _of_scope("site") if row.name not in ROLES]


def _health_publishers(rows: Iterable[Process]) -> list[str]:
    """Return the keys of health and the like of all instances of `rows`."""
    return [key for topic in ACCOUNTS for row in rows for key in _instances(topic.at(row.name), row)]


def _presences(rows: Iterable[Process]) -> list[str]:
    """Return the keys of presence of all instances of `rows`."""
    return [key for row in rows for key in _instances(SERVICE_ALIVE.at(row.name), row)]


def _services() -> Rights:
    shared = shared_services()
    common = [row for row in shared if row.name not in WITH_OWN_IDENTITY]
    return Rights(
        writes=_sorted(
            [
                *_anywhere(row.writes for row in common),
                *_anywhere([(CLOCK, DEPLOYMENT)]),
                *_health_publishers(shared),
            ]
        ),
        reads=_anywhere([*(row.reads for row in common), viewer_topics()]),
        serves=_anywhere([*(row.serves for row in shared), (RUN_SCENARIO,)]),
        asks=_anywhere([FOR_ALL, _asked(common)]),
        keeps=_anywhere([[topic for topic in TOPICS if topic.delivery is Delivery.STATE]]),
        announces=_sorted(
            [
                *_presences(shared),
                *(presence.at(ANY) for presence in PRESENCES if presence not in (SERVICE_ALIVE, USER_ALIVE)),
            ]
        ),
    )


def _of_scope(scope: Literal["site", "user"]) -> Sequence[Process]:
    return [row for row in PROCESSES if row.scope == scope]


def _asked(rows: Iterable[Process]) -> list[Request[Any, Any]]:
    """Return the requests that services of other packages send. Of ours, only `home-assistant` sends one."""
    asks = {row.name: row.plugin.asks if row.plugin is not None else () for row in rows}
    own: tuple[Request[Any, Any], ...] = (SET_THING,) if HOME_ASSISTANT.name in asks else ()
    return [*(request for requests in asks.values() for request in requests), *own]


def _is_personal(row: Topic[Any] | Request[Any, Any]) -> bool:
    return row.placeholder == "user"


def _anywhere(groups: Iterable[Iterable[Topic[Any] | Request[Any, Any]]]) -> tuple[str, ...]:
    return _sorted(row.at(ANY if row.placeholder else "") for rows in groups for row in rows)


def _sorted(keys: Iterable[str]) -> tuple[str, ...]:
    return tuple(sorted(set(keys)))
