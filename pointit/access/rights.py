"""Rights of each role, derived from the tables, and the maximum rate of each key. Pure.

Zenoh limits the rate of each key of a connection at once; `pointit router` the load of an identity, over all
its keys and connections, within seconds (`identity_load.py`).
"""

import functools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, Literal, get_args

from pointit.schemas.system import RUN, instance_of
from pointit.schemas.table_types import Presence
from pointit.schemas.topics import (
    ACCOUNTS,
    ACT_RESULTS,
    ANY,
    BEGIN_ACT,
    BUTTON,
    CARRIER_ALIVE,
    CLOCK,
    CONFIGURATION,
    DEPLOYMENT,
    FIND_REFERENTS,
    IMU,
    KEEPER_ALIVE,
    PRESENCES,
    RAY,
    READ_HISTORY,
    RELEASE_OBJECT,
    REQUESTS,
    RUN_SCENARIO,
    SERVED,
    SERVICE_ALIVE,
    SET_THING,
    SET_UP_HOME,
    SHARD_ALIVE,
    SPEECH,
    STEP,
    STOP_ROBOT,
    THING_STATES,
    TOPICS,
    UNDERSTOOD,
    USE_MAP,
    USER_ALIVE,
    WRIST,
    Delivery,
    Request,
    Topic,
    topic_of,
)
from pointit.services.registry import HOME_ASSISTANT, PROCESSES, RECORDER, Process, add_installed

Row = Topic[Any] | Request[Any, Any]

Role = Literal["user", "services", "service", "web", "ros2", "dashboard", "operator", "supervisor", "router"]
"""Role of an identity: a person's services; the shared services; one shared service with the identity's name;
the page's server; the ROS 2 bridge; a viewer; a viewer who may send requests; unlimited; another router."""

MAX_CACHED = 4096
"""Limit of remembered keys: 60 people have 2600."""
LATEST_HZ = 500.0
"""Maximum rate of a key of which only the newest message counts. Wrists send 200 Hz at most."""
MAX_RATE_HZ = 100.0
"""Maximum rate of a key with states or events, of which each has to be handled."""
MAX_ACCOUNT_HZ = 5.0
"""Maximum rate of a key on which a service reports, once a second or when something changes."""

UNSLOWED = (IMU, RAY)
"""Topics without a maximum rate. Zenoh would pass the oldest of a late batch, of which the newest counts
(200 Hz in batches of 50 ms: 46 instead of 1 ms old). Readers keep the newest, so a flood harms little."""

ROLES: tuple[Role, ...] = get_args(Role)
INTERNAL: tuple[Topic[Any], ...] = (CONFIGURATION, SERVED)
"""Topics for operators of the site."""
PRIVATE: tuple[Topic[Any], ...] = (IMU, WRIST, RAY, SPEECH)
"""Topics that viewers and other people never get: a person's movements and words."""
WITH_OWN_IDENTITY = (RECORDER, "mocap", HOME_ASSISTANT.name)
"""Shared services that may do more than the others, such as read movements, write poses or switch things. On
a secured site each of them needs an identity of its own: `pointit site service add NAME`."""
OF_PEOPLE: tuple[Request[Any, Any], ...] = (FIND_REFERENTS,)
"""Requests of the person and operators only: what a person means by a word. No bridge offers them."""
OF_OPERATORS: tuple[Request[Any, Any], ...] = (RELEASE_OBJECT, SET_THING, SET_UP_HOME, USE_MAP)
"""Requests of operators, the page's too, and the supervisor only: they change what others have or use."""
OF_CARRIERS: tuple[Topic[Any], ...] = (THING_STATES, ACT_RESULTS)
"""Topics that only the service of that name and operators write: a false state blocks a thing, a false result
lies about it. Only it asks whether it may begin an act (`BEGIN_ACT`)."""
FOR_ALL = (STOP_ROBOT,)
"""Requests of all roles: who sees a robot may stop it."""
FOR_MEMBERS = (READ_HISTORY, *FOR_ALL)
"""Requests of all roles but viewers: an answer costs much more than its question."""
ALL = "**"


@functools.lru_cache(maxsize=MAX_CACHED)
def max_rate_hz(key: str) -> float:
    """Return the maximum rate of a key, relative to the site: of each connection, and of all of a person."""
    topic = topic_of(key)
    if topic in (*ACCOUNTS, DEPLOYMENT):
        return MAX_ACCOUNT_HZ
    if topic is None or topic.delivery is Delivery.LATEST:
        return LATEST_HZ
    return MAX_RATE_HZ


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
        return Rights(
            writes=_anywhere([OF_CARRIERS]),
            reads=_anywhere([viewer_topics(), INTERNAL]),
            asks=_anywhere([REQUESTS]),
            announces=(CARRIER_ALIVE.at(ANY),),
        )
    return Rights(reads=_anywhere([viewer_topics()]), asks=_anywhere([FOR_ALL]))


def _bridge(name: str) -> Rights:
    """Return the rights of the bridge `name`: those of its row, and all requests but those of others only.

    The ROS bridge may be present for any person. Its configuration decides for whom.
    """
    (row,) = _named(PROCESSES, name)
    writes = [*_anywhere([row.writes])]
    for topic in ACCOUNTS:
        writes += _numbered(topic.at(name))
    of_others = (*OF_PEOPLE, BEGIN_ACT)
    if name != "web":
        of_others = (*of_others, *OF_OPERATORS)
    requests = [request for request in REQUESTS if request not in of_others]
    return Rights(
        writes=_sorted(writes),
        reads=_anywhere([viewer_topics(), row.reads]),
        asks=_anywhere([requests]),
        announces=(*_numbered(SERVICE_ALIVE.at(name)), *_at(row.announces, ANY)),
    )


def _named(rows: Iterable[Process], name: str) -> list[Process]:
    return [row for row in rows if row.name == name]


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
    instances = _instances_of([*mine, *shards], name)
    # A shard is a process of a shared service: only what it writes and reads of the person is theirs
    writes = _at((BUTTON, STEP, SPEECH, UNDERSTOOD), name)
    reads = [*_anywhere([viewer_topics()])]
    serves: list[str] = []
    for row in mine:
        writes += _at(row.writes, name)
        reads += _at(_personal(row.reads), name)
        serves += _at(_personal(row.serves), name)
    for row in shards:
        writes += _at(_personal(row.writes), name)
        reads += _at(_personal(row.reads), name)
        serves += _at(row.shard_serves or (), name)

    # The name of a run is no person's: the deployment of that name is the operator's
    if not name.startswith(RUN):
        writes.append(DEPLOYMENT.at(name))
    for instance in instances:
        writes += _at(ACCOUNTS, instance)

    asks = [*_anywhere([FOR_MEMBERS])]
    for request in _personal(REQUESTS):
        if request not in OF_OPERATORS:
            asks.append(request.at(name))
    for request in _asked(mine):
        if not _is_personal(request):
            asks += _anywhere([[request]])

    announces = [
        USER_ALIVE.at(name),
        SERVICE_ALIVE.at(RECORDER),  # nobody records without others seeing it
    ]
    announces += [SERVICE_ALIVE.at(instance) for instance in instances]
    announces += [SHARD_ALIVE.at(instance) for instance in _instances_of(shards, name)]
    return Rights(
        writes=_sorted(writes),
        reads=_sorted(reads),
        serves=_sorted(serves),
        asks=_sorted(asks),
        announces=_sorted(announces),
    )


def _instances_of(rows: Iterable[Process], user: str) -> list[str]:
    return [instance_of(row.name, user) for row in rows]


def _service(name: str) -> Rights:
    """Return the rights of the shared service `name`: those of its row, none if it is not installed."""
    rows = _named(shared_services(), name)
    announces = [*_presences(rows), *_carriers(rows)]
    for row in rows:
        announces += _at(row.announces, ANY)
    return Rights(
        writes=_sorted([*_written(rows), *_health_publishers(rows)]),
        reads=_anywhere(row.reads for row in rows),
        serves=_anywhere(row.serves for row in rows),
        asks=_sorted([*_anywhere([FOR_MEMBERS, _asked(rows)]), *_begun(rows)]),
        announces=_sorted(announces),
    )


def shared_services() -> list[Process]:
    """Return the rows of all services of a site but the bridges that have a role of their own."""
    return [row for row in _of_scope("site") if row.name not in ROLES]


def _health_publishers(rows: Iterable[Process]) -> list[str]:
    """Return the keys of health and the like of all instances of `rows`."""
    keys: list[str] = []
    for row in rows:
        for topic in ACCOUNTS:
            keys += _instances(topic.at(row.name), row)
    return keys


def _written(rows: Sequence[Process]) -> list[str]:
    """Return the keys of the topics of `rows`. Those of carriers only under the name of the service."""
    keys: list[str] = []
    for row in rows:
        for topic in row.writes:
            if topic in OF_CARRIERS:
                keys.append(topic.at(row.name))
            else:
                keys.append(_key_of_all(topic))
    return keys


def _presences(rows: Iterable[Process]) -> list[str]:
    """Return the keys of presence of all instances of `rows`."""
    keys: list[str] = []
    for row in rows:
        keys += _instances(SERVICE_ALIVE.at(row.name), row)
    return keys


def _carriers(rows: Iterable[Process]) -> list[str]:
    """Return the keys of presence as carriers of acts of `rows` that write states of things."""
    return [CARRIER_ALIVE.at(row.name) for row in rows if THING_STATES in row.writes]


def _begun(rows: Iterable[Process]) -> list[str]:
    """Return the keys by which those of `rows` that write states of things ask whether an act may begin."""
    return [BEGIN_ACT.at(row.name) for row in rows if THING_STATES in row.writes]


def _services() -> Rights:
    # A service that has an identity of its own is present and reports, but the others lack its rights
    shared = shared_services()
    common = [row for row in shared if row.name not in WITH_OWN_IDENTITY]
    site_writes = _anywhere([(CLOCK, DEPLOYMENT)])
    reads = [*(row.reads for row in common), viewer_topics()]
    serves = [*(row.serves for row in shared), (RUN_SCENARIO,)]
    states = [topic for topic in TOPICS if topic.delivery is Delivery.STATE]
    announces = [*_presences(shared), *_carriers(common)]
    announces += _at((SHARD_ALIVE, KEEPER_ALIVE), ANY)
    return Rights(
        writes=_sorted([*_written(common), *site_writes, *_health_publishers(shared)]),
        reads=_anywhere(reads),
        serves=_anywhere(serves),
        asks=_sorted([*_anywhere([FOR_MEMBERS, _asked(common)]), *_begun(common)]),
        keeps=_anywhere([states]),
        announces=_sorted(announces),
    )


def _of_scope(scope: Literal["site", "user"]) -> Sequence[Process]:
    return [row for row in PROCESSES if row.scope == scope]


def _asked(rows: Iterable[Process]) -> list[Request[Any, Any]]:
    """Return the requests that services of other packages send. Ours send none."""
    requests: list[Request[Any, Any]] = []
    for row in rows:
        if row.plugin is not None:
            requests += row.plugin.asks
    return requests


def _is_personal(row: Row) -> bool:
    return row.placeholder == "user"


def _personal(rows: Iterable[Row]) -> Iterator[Row]:
    return filter(_is_personal, rows)


def _at(rows: Iterable[Row | Presence], name: str) -> list[str]:
    return [row.at(name) for row in rows]


def _anywhere(groups: Iterable[Iterable[Row]]) -> tuple[str, ...]:
    """Return the keys of all rows of `groups`, each for whatever name."""
    return _sorted(map(_key_of_all, chain.from_iterable(groups)))


def _key_of_all(row: Row) -> str:
    return row.at(ANY if row.placeholder else "")


def _sorted(keys: Iterable[str]) -> tuple[str, ...]:
    return tuple(sorted(set(keys)))
