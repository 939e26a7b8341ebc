"""Rights of each role on every row of the tables, at a real router over TLS."""

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from pointit.access.site_folder import SiteFolder
from pointit.schemas import topics
from pointit.services.registry import PROCESSES, SHOWN
from tests.integration.access.secured import NAMES, Member, make_site, routed

PEOPLE = ("anna", "ben")
LIMITED = [name for name in NAMES if name != "supervisor"]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> SiteFolder:
    return make_site(tmp_path_factory.mktemp("site") / "lab")


@pytest.fixture(scope="module")
def members(site: SiteFolder) -> Iterator[dict[str, Member]]:
    with routed(site), ExitStack() as stack:
        yield {name: stack.enter_context(Member(site, name)) for name in NAMES}


def topic_keys() -> dict[str, tuple[object, str]]:
    """Every topic for some names: key to row and name."""
    keys: dict[str, tuple[object, str]] = {}
    for topic in topics.TOPICS:
        names = {
            "": ("",),
            "user": PEOPLE,
            "service": (
                "pui",
                "pui.anna",
                "pui.ben",
                "selector.anna",
                "pointing.anna",
                "pointing.ben",
                "web",
                "foxglove",
                "agv-tracker",
                "supervisor",
                "anna",
            ),
            "name": ("anna", "ben", "hall"),
            "carrier": ("reactions", "home-assistant", "conveyor-sim", "anna", "foxglove"),
        }.get(topic.placeholder, ("thing",))
        keys |= {topic.at(name): (topic, name) for name in names}
    return keys


def may_write(me: str, topic: object, name: str) -> bool:
    """Return True if `me` may write `topic` for `name`, computed independently of the code under test."""
    role = NAMES[me]
    writers = [row for row in PROCESSES if topic in row.writes]
    if topic in topics.ACCOUNTS:
        personal = [f"{row.name}.{me}" for row in PROCESSES if row.scope == "user"]
        personal += [f"pui.{me}", f"selector.{me}"]
        shared = [row.name for row in PROCESSES if row.scope == "site" and row.name not in ("web", "ros2")]
        shared += ["pui.anna", "pui.ben", "selector.anna"]
        own = {"user": personal, "services": shared, "web": ["web"], "service": ["foxglove"]}
        return name in own.get(role, [])
    if topic in (topics.THING_STATES, topics.ACT_RESULTS):
        return role == "operator" or (role == "services" and name in ("reactions", "conveyor-sim"))
    if role == "user":
        if topic is topics.DEPLOYMENT:
            return name == me
        # cursor, hovers and names, which a person's shards write
        return name == me and (
            any(row.scope == "user" for row in writers)
            or topic in (topics.CURSOR, topics.HOVER, topics.CLAIM, topics.ANNOUNCED)
            or topic in (topics.SPEECH, topics.UNDERSTOOD)
        )
    if role == "services":
        others = ("web", "ros2", "mocap", "home-assistant")  # have identities of their own
        shared_writers = any(row.scope == "site" and row.name not in others for row in writers)
        return shared_writers or topic in (topics.CLOCK, topics.DEPLOYMENT)
    return role == "web" and topic in (
        topics.WRIST,
        topics.BUTTON,
        topics.STEP,
        topics.SPEECH,
        topics.POSE,  # of those who wear a headset
    )


OF_PEOPLE = (topics.FIND_REFERENTS,)
OF_CARRIERS = (topics.BEGIN_ACT,)


def may_read(me: str, topic: object, name: str) -> bool:
    # named here again on purpose: with `rights.PRIVATE` this could not fail when one is left out of it
    if topic in (topics.IMU, topics.WRIST, topics.RAY, topics.SPEECH):
        if NAMES[me] == "user":
            return name == me
        return NAMES[me] == "services" and topic is topics.RAY  # pui needs rays; nobody shared needs the rest
    if topic in (topics.CONFIGURATION, topics.SERVED):
        return NAMES[me] == "operator"
    if NAMES[me] == "service":
        return topic in SHOWN
    return True


def test_writes_arrive_exactly_where_they_may(members: dict[str, Member]) -> None:
    supervisor = members["supervisor"]
    for me in LIMITED:
        member = members[me]
        with supervisor.listening("**", "**/@may/**") as ear:
            supervisor.settle(members["operator"])
            member.put(*topic_keys())
            ear.hears(member.mark())
        expected = {key for key, (topic, name) in topic_keys().items() if may_write(me, topic, name)}
        assert ear.heard() == expected, me


def test_writes_below_another_name_arrive_nowhere_at_all(members: dict[str, Member]) -> None:
    evil = members["anna"]
    others = [member for me, member in members.items() if me != "anna"]  # it hears itself without a router
    with ExitStack() as stack:
        ears = [stack.enter_context(it.listening("**", "users/ben/imu", "users/ben/pose")) for it in others]
        end = stack.enter_context(members["supervisor"].listening("**/@may/**"))
        for each in others:
            each.settle(members["supervisor"])
        evil.put("users/ben/imu", "users/ben/pose", "users/*/imu", "users/**", "**")
        end.hears(evil.mark())
        for each in others:  # what was on its way to them has come
            with each.listening(f"@may/{each.name}/**") as own:
                key = f"@may/{each.name}/end"
                own.hears(key, lambda key=key: members["supervisor"].put(key))
        assert [ear.keys for ear in ears] == [[]] * len(others)


@pytest.mark.parametrize("me", LIMITED)
def test_reads_get_exactly_what_they_may(me: str, site: SiteFolder, members: dict[str, Member]) -> None:
    """Each key is written once on a connection, so its rate limits none: it would if keys shared a rate."""
    end = f"@may/{me}/end"
    with Member(site, "supervisor") as speaker, members[me].listening(*topic_keys(), end) as ear:
        members[me].settle(speaker)
        speaker.put(*topic_keys(), end)
        ear.hears(end)
    assert ear.heard() == {key for key, (topic, name) in topic_keys().items() if may_read(me, topic, name)}


@pytest.mark.parametrize("me", LIMITED)
def test_subscription_to_everything_gets_nothing(me: str, members: dict[str, Member]) -> None:
    speaker = members["supervisor"]
    end = f"@may/{me}/end"
    with members[me].listening("**", "users/**", "users/*/imu", "users/*/wrist", "**/@adv/**", end) as ear:
        members[me].settle(speaker)
        speaker.put("users/ben/imu", "users/anna/imu", "secret", "map", "users/ben/pose/@adv/x", end)
        ear.hears(end)
    assert ear.heard() == set()


def request_keys() -> dict[str, tuple[topics.Request[Any, Any], str]]:
    return {
        row.at(name): (row, name)
        for row in topics.REQUESTS
        for name in (PEOPLE if row.placeholder else ("",))
    }


def test_requests_are_answered_for_whom_they_may_be(members: dict[str, Member]) -> None:
    keys = request_keys()
    with members["supervisor"].serving(*keys):
        members["supervisor"].settle(members["operator"])
        for me in LIMITED:
            expected = {
                key
                for key, (row, name) in keys.items()
                if NAMES[me] == "operator"
                or (NAMES[me] == "web" and row not in (*OF_PEOPLE, *OF_CARRIERS))
                or row is topics.STOP_ROBOT
                or (row is topics.READ_HISTORY and NAMES[me] != "dashboard")
                or (
                    NAMES[me] == "user"
                    and row.placeholder == "user"
                    and name == me
                    and row not in (topics.RELEASE_OBJECT, topics.SET_THING)
                )
            }
            assert members[me].answered(*keys) == expected, me


def may_serve(me: str, row: topics.Request[Any, Any], name: str) -> bool:
    servers = [process for process in PROCESSES if row in process.serves]
    if NAMES[me] == "user":
        return name == me and (
            row is topics.SET_WORKSPACE or any(server.scope == "user" for server in servers)
        )
    shared = row is topics.RUN_SCENARIO or any(server.scope == "site" for server in servers)
    return shared and NAMES[me] == "services"


def test_only_who_serves_a_request_is_asked(members: dict[str, Member]) -> None:
    keys = request_keys()
    for me in LIMITED:
        with members[me].serving(*keys) as asked:
            members[me].settle(members["supervisor"])
            answered = members["supervisor"].answered(*keys)
        expected = {key for key, (row, name) in keys.items() if may_serve(me, row, name)}
        assert answered == expected, me
        assert set(asked) == expected, me


def test_presence_is_told_of_oneself_only_and_seen_by_all(members: dict[str, Member]) -> None:
    everybody = [topics.USER_ALIVE.at("anna"), topics.USER_ALIVE.at("ben")]
    everybody += [
        topics.SERVICE_ALIVE.at(name)
        for name in ("pointing.anna", "pointing.ben", "pui", "web", "foxglove", "agv-tracker", "rogue")
    ]
    shards = {
        row.at(name)
        for row in (topics.SERVICE_ALIVE, topics.SHARD_ALIVE)
        for name in ("pui.anna", "selector.anna")
    }
    carriers = set(map(topics.CARRIER_ALIVE.at, ("reactions", "home-assistant", "conveyor-sim", "foxglove")))
    everybody += sorted(shards | carriers)
    expected = {
        "anna": {topics.USER_ALIVE.at("anna"), topics.SERVICE_ALIVE.at("pointing.anna"), *shards},
        "ben": {topics.USER_ALIVE.at("ben"), topics.SERVICE_ALIVE.at("pointing.ben")},
        "services": {
            *map(topics.SERVICE_ALIVE.at, ("pui", "foxglove", "agv-tracker")),
            *map(topics.CARRIER_ALIVE.at, ("reactions", "conveyor-sim")),
            *shards,
        },
        "operator": carriers,
        "web": {topics.SERVICE_ALIVE.at("web")},
        "foxglove": {topics.SERVICE_ALIVE.at("foxglove")},
    }
    for me in LIMITED:
        with members[me].present(*everybody):
            members[me].settle(members["supervisor"])
            for onlooker in LIMITED:
                if onlooker != me:
                    seen = members[onlooker].sees(*(row.at(topics.ANY) for row in topics.PRESENCES))
                    assert seen == expected.get(me, set()), (me, onlooker)
        members[me].settle(members["supervisor"])
