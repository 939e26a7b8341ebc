"""Rules as a router applies them, worked out without one."""

from dataclasses import replace
from typing import Any

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from pointit.access.rights import ALL, ROLES, Rights, Role, rights_of
from pointit.access.router_configuration import (
    Member,
    RouterSite,
    common_name,
    configuration,
    rules_of,
    to_json5,
)
from pointit.runtime.errors import ConfigError
from pointit.schemas import topics
from pointit.schemas.topics import DEPLOYMENT, READ_HISTORY, SELECTION_EVENTS

NAMES = st.from_regex(r"[A-Za-z0-9_][A-Za-z0-9_.\-]{0,20}", fullmatch=True)


def permits(rules: list[dict[str, Any]], message: str, flow: str, key: str) -> bool:
    """Zenoh's behaviour: a rule applies if one of its patterns includes the whole key."""
    return any(
        message in rule["messages"]
        and flow in rule["flows"]
        and any(zenoh.KeyExpr(pattern).includes(zenoh.KeyExpr(key)) for pattern in rule["key_exprs"])
        for rule in rules
    )


def routed(site: str = "lab", port: int = 7447, **more: Any) -> RouterSite:
    roles: dict[str, Role] = {"router": "router", "anna": "user", "ben": "user", "dashboard1": "dashboard"}
    members = [Member(name=me, role=role, common_name=common_name(site, me, 1)) for me, role in roles.items()]
    return RouterSite(site=site, port=port, members=members, **more)


@given(me=NAMES, other=NAMES)
def test_nobody_writes_below_another_name(me: str, other: str) -> None:
    rules = rules_of("lab", me, rights_of("user", me))
    for topic in topics.TOPICS:
        if topic.placeholder != "user":
            continue
        key = f"pointit/lab/{topic.at(other)}"
        for message in ("put", "declare_queryable", "reply", "liveliness_token"):
            for below in (key, f"{key}/@adv/pub/1/2/_", f"{key}/@may/{me}/writes"):
                assert me == other or not permits(rules, message, "ingress", below)


@given(me=NAMES, role=st.sampled_from(ROLES), site=NAMES)
def test_nobody_has_rights_on_another_site(me: str, role: Role, site: str) -> None:
    rules = rules_of(site, me, rights_of(role, me))
    for rule in rules:
        for pattern in rule["key_exprs"]:
            assert pattern.startswith(f"pointit/{site}/")
            zenoh.KeyExpr(pattern)  # is one


@pytest.mark.parametrize("role", ROLES)
def test_late_joiners_are_granted_with_the_key(role: Role) -> None:
    rights = rights_of(role, "anna")
    rules = rules_of("lab", "anna", rights)
    below = "@adv/pub/0123/4/_"
    for key in rights.writes:
        assert permits(rules, "put", "ingress", f"pointit/lab/{key}/{below}")
        assert permits(rules, "declare_queryable", "ingress", f"pointit/lab/{key}/{below}")
        assert permits(rules, "liveliness_token", "ingress", f"pointit/lab/{key}/{below}")
        assert permits(rules, "reply", "ingress", f"pointit/lab/{key}")
    for key in rights.reads:
        assert permits(rules, "declare_subscriber", "ingress", f"pointit/lab/{key}/@adv/pub/**")
        assert permits(rules, "query", "ingress", f"pointit/lab/{key}/@adv/**")
        assert permits(rules, "declare_liveliness_subscriber", "ingress", f"pointit/lab/{key}/@adv/pub/**")
        assert permits(rules, "liveliness_token", "egress", f"pointit/lab/{key}/{below}")
        assert permits(rules, "put", "egress", f"pointit/lab/{key}/{below}")
        assert permits(rules, "reply", "egress", f"pointit/lab/{key}")


@pytest.mark.parametrize("role", ROLES)
def test_each_right_grants_its_own_test(role: Role) -> None:
    rights = rights_of(role, "anna")
    rules = rules_of("lab", "anna", rights)
    for verb in ("writes", "reads", "serves", "asks"):
        for key in getattr(rights, verb):
            assert permits(rules, "put", "ingress", f"pointit/lab/{key}/@may/anna/{verb}")
            assert permits(rules, "put", "egress", f"pointit/lab/{key}/@may/anna/{verb}")
    assert permits(rules, "declare_subscriber", "ingress", "pointit/lab/**/@may/anna/**")
    assert permits(rules, "put", "ingress", "pointit/lab/@may/anna/joins")


def test_dashboards_read_what_is_shown_and_write_or_answer_nothing() -> None:
    rights = rights_of("dashboard", "dashboard1")
    assert (rights.writes, rights.serves, rights.keeps, rights.announces) == ((), (), (), ())
    assert rights.asks == (topics.STOP_ROBOT.at(topics.ANY),)
    assert not any(key.endswith(("/imu", "/wrist", "/ray")) for key in rights.reads)


SEVERAL = ("web", "web.2", "web.11", "webcam", "pui", "foxglove", "pointing.web", "pointing.web.2", "anna")


@pytest.mark.parametrize(
    ("role", "names", "allowed"),
    [("services", ("robot.quad", "robot", "robots", "keeper.quad", "pointing.quad"), 2), ("web", SEVERAL, 3)],
)
def test_process_with_several_instances_reports_under_its_own_names_only(
    role: Role, names: tuple[str, ...], allowed: int
) -> None:
    rules = rules_of("lab", role, rights_of(role, role))
    for message, row in (("put", topics.HEALTH), ("liveliness_token", topics.SERVICE_ALIVE)):
        may = [name for name in names if permits(rules, message, "ingress", f"pointit/lab/{row.at(name)}")]
        assert may == list(names[:allowed])
    state = f"pointit/lab/{topics.ROBOT_STATE.at('quad')}"
    assert permits(rules, "put", "ingress", state) is (role == "services")


@given(name=NAMES)
def test_ros_bridge_may_stand_for_people_unlike_the_web(name: str) -> None:
    def may(role: Role, message: str, key: str) -> bool:
        return permits(rules_of("lab", role, rights_of(role, role)), message, "ingress", f"pointit/lab/{key}")

    for topic in (topics.RAY, topics.INTERACTION, topics.PROFILE):
        assert may("ros2", "put", topic.at(name))
        assert not may("web", "put", topic.at(name))
    assert may("ros2", "liveliness_token", topics.USER_ALIVE.at(name))
    assert not may("web", "liveliness_token", topics.USER_ALIVE.at(name))
    assert not may("ros2", "liveliness_token", topics.SERVICE_ALIVE.at(f"supervisor.{name}"))
    of_people_and_operators = (topics.FIND_REFERENTS, topics.RELEASE_OBJECT)
    assert not {row.at(topics.ANY) for row in of_people_and_operators} & set(rights_of("ros2", "ros2").asks)


def test_services_with_more_rights_have_an_identity_of_their_own() -> None:
    shared = rights_of("services", "services")
    capture = rights_of("service", "mocap")
    home = rights_of("service", "home-assistant")
    for right, key in (("reads", topics.IMU.key), ("writes", topics.POSE.key)):
        pattern = key.replace("{user}", "*")
        assert pattern in getattr(capture, right)
        assert pattern not in getattr(shared, right)
    states = topics.THING_STATES.at("home-assistant")
    assert (states in home.writes, states in shared.writes, states in capture.writes) == (True, False, False)


def test_nothing_is_granted_without_a_rule() -> None:
    made = configuration([routed()])
    control = made["access_control"]
    assert control["default_permission"] == "deny"
    assert {rule["permission"] for rule in control["rules"]} == {"allow"}

    ids = [rule["id"] for rule in control["rules"]]
    assert len(ids) == len(set(ids))
    for policy, member in zip(control["policies"], routed().members, strict=True):
        assert all(rule.startswith(f"lab/{member.name}/") for rule in policy["rules"])
    assert {name for each in control["subjects"] for name in each["cert_common_names"]} == {
        "lab/router/1",
        "lab/anna/1",
        "lab/ben/1",
        "lab/dashboard1/1",
    }
    assert made["adminspace"] == {"enabled": False, "permissions": {"read": False, "write": False}}
    assert made["scouting"]["gossip"] == made["scouting"]["multicast"] == {"enabled": False}
    assert all("enable_mtls=true" in endpoint for endpoint in made["listen"]["endpoints"])


def test_every_row_of_the_tables_has_a_limit() -> None:
    limits = configuration([routed()])["low_pass_filter"]

    def limit(message: str, key: str) -> int:
        found: list[int] = [
            each["size_limit"]
            for each in limits
            if message in each["messages"]
            and any(zenoh.KeyExpr(pattern).includes(zenoh.KeyExpr(key)) for pattern in each["key_exprs"])
        ]
        return min(found)

    for topic in topics.TOPICS:
        name = "anna" if topic.placeholder else ""
        assert limit("put", f"pointit/lab/{topic.at(name)}") == topic.message.max_bytes
        assert limit("reply", f"pointit/lab/{topic.at(name)}") == topic.message.max_bytes
    for request in topics.REQUESTS:
        name = "anna" if request.placeholder else ""
        assert limit("query", f"pointit/lab/{request.at(name)}") == request.query.max_bytes
    assert limit("put", "pointit/lab/anything/at/all") == 1024 * 1024


def test_each_persons_key_is_thinned_by_its_own_rule() -> None:
    made = configuration([routed(dashboard_rate_hz=20.0)])
    people, history, thinned = made["downsampling"]
    keys = [rule["key_expr"] for rule in thinned["rules"]]
    assert "pointit/lab/users/anna/cursor" in keys
    assert not any("*" in key for key in keys)
    assert thinned["link_protocols"] == ["quic"]
    assert {endpoint.partition("/")[0] for endpoint in made["listen"]["endpoints"]} == {"tls", "quic"}
    (quic,) = (endpoint for endpoint in made["listen"]["endpoints"] if endpoint.startswith("quic"))
    assert "?multistream=0#" in quic  # else questions overtake the keys they are about
    assert configuration([routed()])["downsampling"] == [people, history]


def test_each_persons_key_except_imu_and_ray_has_a_rate() -> None:
    people, _history = configuration([routed()])["downsampling"]
    assert (people["messages"], people["flows"]) == (["put"], ["ingress"])
    assert "link_protocols" not in people

    rates_hz = {rule["key_expr"]: rule["freq"] for rule in people["rules"]}
    assert set(rates_hz) == {
        f"pointit/lab/{key}"
        for member in routed().members
        if member.role == "user"
        for key in rights_of("user", member.name).writes
        if key
        not in (
            topics.IMU.at(member.name),
            topics.RAY.at(member.name),
        )  # of a late batch, the newest is wanted
    }
    assert not any("*" in key for key in rates_hz), "keys of one rule would share its rate"
    assert rates_hz["pointit/lab/users/anna/claim"] < rates_hz["pointit/lab/users/anna/cursor"]


def test_configuration_is_accepted_by_zenoh() -> None:
    zenoh.Config.from_json5(to_json5([routed(dashboard_rate_hz=20.0, uplinks=("tls/building:7447",))]))


def test_the_router_watches_the_end_of_certificates_that_there_are() -> None:
    """Zenoh would warn about a client without certificate like about a rejected one."""
    assert configuration([routed()])["transport"]["link"]["tls"] == {"close_link_on_expiration": True}
    by_password = configuration([routed(password=True)])["transport"]
    assert "tls" not in by_password["link"]
    assert by_password["auth"] == {"usrpwd": {"dictionary_file": "users.txt"}}
    zenoh.Config.from_json5(to_json5([routed(password=True)]))


@pytest.mark.parametrize(
    ("sites", "sentence"),
    [
        ([routed("a", 1), routed("a", 2)], "site a is given twice"),
        ([routed("a", 1), routed("b", 1)], "sites a and b both have port 1"),
        ([routed("a", 1), routed("b", 2, password=True)], "site b goes by passwords"),
        ([routed("a", 1, password=True, uplinks=("tls/x:1",))], "joins no other"),
    ],
)
def test_sites_that_cannot_share_a_router(sites: list[RouterSite], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        configuration(sites)


def test_a_right_that_is_missing_is_no_rule() -> None:
    rules = rules_of("lab", "x", Rights(watches=()))
    assert not any(permits(rules, "query", "ingress", f"pointit/lab/{topics.IMU.at('x')}") for _ in rules)
    assert all("users" not in key for rule in rules for key in rule["key_exprs"])


def test_former_identities_have_a_rule_that_admits_nothing() -> None:
    """Without a rule Zenoh would deny as much, and not log who tried."""
    made = configuration([replace(routed(), former=["lab/anna/1", "lab/gone/3"])])["access_control"]
    (subject,) = (each for each in made["subjects"] if "lab/gone/3" in each["cert_common_names"])
    (policy,) = (each for each in made["policies"] if subject["id"] in each["subjects"])
    (rule,) = (each for each in made["rules"] if each["id"] in policy["rules"])
    assert (rule["flows"], rule["key_exprs"]) == (["egress"], ["pointit/lab/nothing"])


def test_person_whose_name_begins_like_a_runs_tells_no_deployment() -> None:
    assert DEPLOYMENT.at("anna") in rights_of("user", "anna").writes
    assert not [key for key in rights_of("user", "run.scenario_4").writes if key.startswith("deployment/")]


@pytest.mark.parametrize("role", [role for role in ROLES if role != "dashboard"])
def test_history_is_readable_for_selection_readers_except_viewers(role: Role) -> None:
    rights = rights_of(role, "foxglove")  # the name of a service, for the role of single services
    reads, asks = ({ALL, row.at()} for row in (SELECTION_EVENTS, READ_HISTORY))
    assert reads & set(rights.reads)
    assert asks & set(rights.asks)


@pytest.mark.parametrize("role", ["user", "web", "dashboard"])
def test_each_display_may_read_what_guidance_is_made_of(role: Role) -> None:
    rules = rules_of("lab", "anna", rights_of(role, "anna"))
    for key in (
        topics.MANNER.key, topics.INTERACTION.at("anna"), topics.DEPLOYMENT.at("run.scenario_3"),
        topics.THING_STATES.at("home-assistant"), topics.SELECTION_EVENTS.key,
    ):  # fmt: skip
        assert permits(rules, "declare_subscriber", "ingress", f"pointit/lab/{key}"), (role, key)
