"""AGVs at a broker as tracked objects."""

import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.agv_tracker.config import AgvTrackerConfig
from pointit.bridges.agv_tracker.fleet import MAX_AGVS, Fleet
from pointit.schemas import NS_PER_S
from tests.support.bench import START_NS


def fleet_of(**parameters: object) -> Fleet:
    return Fleet(AgvTrackerConfig.model_validate({"broker": "hub", **parameters}))


def at(x: object, y: object, *, number: int = 1, vx: object = 0.0, **position: Any) -> bytes:
    place = {"x": x, "y": y, "theta": 0.5, "mapId": "hall", "positionInitialized": True, **position}
    time = f"2026-03-02T08:{number // 60:02d}:{number % 60:02d}.00Z"
    message = {"headerId": number, "timestamp": time, "agvPosition": place, "velocity": {"vx": vx}}
    return json.dumps(message).encode()


def topic(kind: str, serial: str = "7") -> str:
    return f"uagv/v2/acme/{serial}/{kind}"


def places(fleet: Fleet, now_ns: int = START_NS) -> dict[str, tuple[float, float]]:
    return {each.id: each.position_m[:2] for each in fleet.objects(now_ns)}


def test_each_agv_is_an_object_at_its_last_place() -> None:
    fleet = fleet_of(leave_out=("acme/9",))
    assert fleet.on_message(topic("visualization"), at(1.0, 2.0, deviationRange=0.1), START_NS)
    assert fleet.on_message(topic("visualization"), at(1.5, 2.0, number=2), START_NS)
    assert fleet.on_message(topic("visualization"), at(0.0, 0.0, number=1), START_NS), "late"
    assert fleet.on_message(topic("visualization", "8"), at(3.0, 4.0, deviationRange=0.1), START_NS)
    assert fleet.on_message(topic("visualization", "9"), at(3.0, 4.0), START_NS)
    first, second = fleet.objects(START_NS)
    assert (first.id, first.kind, first.position_m, first.yaw_rad) == (
        "acme-7",
        "robot",
        (1.5, 2.0, 0.0),
        0.5,
    )
    assert (second.id, second.position_sigma_m) == ("acme-8", 0.1)


def test_moving_agv_is_extrapolated_for_a_short_time() -> None:
    fleet = fleet_of()
    fleet.on_message(topic("visualization"), at(1.0, 1.0, vx=0.5, theta=math.pi / 2), START_NS)
    ((x, y),) = places(fleet, START_NS + NS_PER_S).values()
    assert (x, y) == pytest.approx((1.0, 1.5)), "the velocity is that of the AGV's own frame"
    assert places(fleet, START_NS + 3 * NS_PER_S) == {}


def test_agv_has_left_when_off_on_another_map_or_silent() -> None:
    fleet = fleet_of(map_id="hall")
    gone = b'{"headerId": 1, "connectionState": "CONNECTIONBROKEN"}'
    for number, (kind, payload) in enumerate(
        (("connection", gone), ("visualization", at(0, 0, number=99, mapId="yard")))
    ):
        fleet.on_message(topic("visualization"), at(1.0, 2.0, number=10 + number), START_NS)
        assert places(fleet) == {"acme-7": (1.0, 2.0)}
        fleet.on_message(topic(kind), payload, START_NS)
        assert places(fleet) == {}

    fleet = fleet_of()
    fleet.on_message(topic("visualization"), at(1.0, 2.0), START_NS)
    assert places(fleet, START_NS + 34 * NS_PER_S)
    assert not places(fleet, START_NS + 36 * NS_PER_S)

    fleet.on_message(topic("visualization"), at(1.0, 2.0), START_NS)
    fleet.forget()
    assert places(fleet) == {}


def test_agv_is_not_shown_when_it_loses_its_position() -> None:
    fleet = fleet_of()
    fleet.on_message(topic("state"), at(1.0, 2.0), START_NS)
    lost = at(None, None, number=2, theta=None, positionInitialized=False)
    fleet.on_message(topic("state"), lost, START_NS)
    assert (places(fleet), fleet.problem) == ({}, "")


@pytest.mark.parametrize(
    "prefix", ["uagv/2.0", "uagv/2.1.0", "/uagv/v2", "uagv", "plant/hall 3/uagv/v3", "robots"]
)
def test_topic_prefix_selects_topics_with_other_first_levels(prefix: str) -> None:
    name = f"{prefix}/acme/7/state"
    assert not fleet_of().on_message(name, at(1.0, 2.0), START_NS)
    fleet = fleet_of(topic_prefix=prefix)
    assert fleet.on_message(name, at(1.0, 2.0), START_NS)
    assert places(fleet) == {"acme-7": (1.0, 2.0)}
    assert not fleet.on_message(topic("state"), at(1.0, 2.0), START_NS)


def test_other_devices_of_a_broker_are_ignored() -> None:
    fleet = fleet_of()
    for name, payload in (
        ("homeassistant/sensor/door/state", b"ON"),
        ("homeassistant/light/hall/lamp/state", b'{"state": "ON", "brightness": 200}'),
        ("zigbee2mqtt/room/lamp/a/state", b'{"linkquality": 90}'),
    ):
        assert not fleet.on_message(name, payload, START_NS)
    assert (fleet.problem, fleet.objects(START_NS)) == ("", ())


def test_agv_of_two_versions_is_shown_by_the_first_one() -> None:
    fleet = fleet_of()
    fleet.on_message("uagv/v1/acme/7/state", at(1.0, 2.0), START_NS)
    fleet.on_message("uagv/v2/acme/7/state", at(9.0, 9.0), START_NS)
    assert places(fleet) == {"acme-7": (1.0, 2.0)}


def test_unreadable_fields_are_named_once() -> None:
    fleet = fleet_of()
    for number, degrees in enumerate((170.0, 171.0)):
        message = at(1.0 + number, 2.0, number=number, theta=degrees, deviationRange=-1, vx="fast")
        assert fleet.on_message(topic("visualization"), message, START_NS)
    (item,) = fleet.objects(START_NS)
    assert (item.position_m, item.yaw_rad, item.position_sigma_m) == ((2.0, 2.0, 0.0), None, None)
    assert fleet.problem == (
        "uagv/v2/acme/7/visualization: theta is 170.0, deviationRange is -1, vx is 'fast'; correct it at the "
        "AGV, or update its software to keep VDA 5050"
    )
    fleet.on_message(topic("visualization"), at(1.0, 2.0, number=9), START_NS)
    assert fleet.problem == ""


@pytest.mark.parametrize("where", [{"x": "here"}, {"positionInitialized": "perhaps"}])
def test_moving_agv_is_not_shown_when_its_position_is_unreadable(
    where: dict[str, Any],
) -> None:
    fleet = fleet_of()
    fleet.on_message(topic("state"), at(1.0, 0.0, vx=1.0), START_NS)
    now_ns = START_NS
    for seconds in range(1, 5):
        now_ns = START_NS + seconds * NS_PER_S
        place: dict[str, Any] = {"x": 1.0, "y": 0.0, "vx": 1.0, **where}
        place["number"] = 1 + seconds
        fleet.on_message(topic("state"), at(**place), now_ns)
    assert places(fleet, now_ns) == {}
    assert next(iter(where)) in fleet.problem


def test_agv_without_a_map_is_reported_when_one_is_configured() -> None:
    fleet = fleet_of(map_id="hall")
    fleet.on_message(topic("state"), at(1.0, 0.0, mapId=None), START_NS)
    assert places(fleet) == {}
    assert "mapId is missing" in fleet.problem
    fleet.on_message(topic("state"), at(1.0, 0.0, number=2), START_NS)
    assert (len(places(fleet)), fleet.problem) == (1, "")


def test_malformed_message_is_reported_until_the_next_one() -> None:
    fleet = fleet_of()
    assert not fleet.on_message(topic("state"), b"\x00\x01", START_NS)
    assert fleet.objects(START_NS) == ()
    assert fleet.problem.startswith("uagv/v2/acme/7/state: a message is not one of VDA 5050")
    fleet.on_message(topic("state"), at(1.0, 2.0), START_NS)
    assert fleet.problem == ""


def test_number_of_agvs_is_bounded() -> None:
    fleet = fleet_of()
    for serial in range(MAX_AGVS + 9):
        fleet.on_message(topic("visualization", f"{serial}"), at(1.0, 2.0), START_NS)
    assert len(fleet.objects(START_NS)) == MAX_AGVS


def retained(fleet: Fleet, kind: str, payload: bytes, now_ns: int) -> None:
    fleet.on_message(topic(kind), payload, now_ns, is_retained=True)


YESTERDAY_NS = 1_795_849_925_120_000_000
"""Timestamp of the state below, which a broker had retained."""
STATE = b"""{"headerId": 812, "timestamp": "2026-11-28T07:12:05.120Z", "version": "2.0.0",
  "manufacturer": "acme", "serialNumber": "7", "orderId": "", "orderUpdateId": 0, "lastNodeId": "",
  "lastNodeSequenceId": 0, "nodeStates": [], "edgeStates": [], "actionStates": [], "driving": false,
  "operatingMode": "AUTOMATIC", "errors": [], "safetyState": {"eStop": "NONE", "fieldViolation": false},
  "agvPosition": {"x": 1.5, "y": 2.0, "theta": 0.0, "mapId": "hall", "positionInitialized": true}}"""
GONE = b'{"timestamp": "2026-11-28T07:12:40.000Z", "connectionState": "OFFLINE"}'
HERE = b'{"timestamp": "2026-11-28T07:00:00.000Z", "connectionState": "ONLINE"}'


@pytest.mark.parametrize("connection", [GONE, HERE, None], ids=["offline", "online", "unknown"])
@pytest.mark.parametrize("is_state_first", [True, False])
def test_agv_is_not_shown_by_a_retained_state_of_yesterday(
    connection: bytes | None, *, is_state_first: bool
) -> None:
    fleet = fleet_of()
    now_ns = YESTERDAY_NS + 86_400 * NS_PER_S
    messages = [("state", STATE)]
    if connection is not None:
        messages.insert(is_state_first, ("connection", connection))
    for kind, payload in messages:
        retained(fleet, kind, payload, now_ns)
    assert (places(fleet, now_ns), fleet.problem) == ({}, "")


def test_agv_that_is_off_is_hidden_despite_an_earlier_state() -> None:
    fleet = fleet_of()
    fleet.on_message(topic("connection"), GONE, YESTERDAY_NS + 40 * NS_PER_S)
    fleet.on_message(topic("state"), STATE, YESTERDAY_NS + 40 * NS_PER_S)
    assert places(fleet, YESTERDAY_NS + 40 * NS_PER_S) == {}


def test_retained_state_counts_for_the_rest_of_its_time() -> None:
    fleet = fleet_of()
    retained(fleet, "state", STATE, YESTERDAY_NS + 30 * NS_PER_S)
    assert places(fleet, YESTERDAY_NS + 34 * NS_PER_S) == {"acme-7": (1.5, 2.0)}
    assert places(fleet, YESTERDAY_NS + 36 * NS_PER_S) == {}


def test_agv_that_returns_is_shown_by_its_next_state() -> None:
    fleet = fleet_of()
    retained(fleet, "connection", GONE, YESTERDAY_NS)
    fleet.on_message(topic("connection"), HERE, YESTERDAY_NS)
    fleet.on_message(topic("state"), STATE, YESTERDAY_NS)
    assert places(fleet, YESTERDAY_NS) == {"acme-7": (1.5, 2.0)}


@given(
    st.sampled_from([topic("state"), topic("connection"), "a/b", "////", "", "a/////state"]),
    st.binary(max_size=99),
)
def test_malformed_messages_never_raise(name: str, payload: bytes) -> None:
    assert not fleet_of().on_message(name, payload, START_NS)
