"""AGVs at a broker as tracked objects."""

import json
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


def at(x: float, y: float, *, number: int = 1, vx: float = 0.0, **position: Any) -> bytes:
    place = {"x": x, "y": y, "theta": 0.5, "mapId": "hall", "positionInitialized": True, **position}
    return json.dumps({"headerId": number, "agvPosition": place, "velocity": {"vx": vx}}).encode()


def topic(kind: str, serial: str = "7") -> str:
    return f"uagv/v2/acme/{serial}/{kind}"


def places(fleet: Fleet, now_ns: int = START_NS) -> dict[str, tuple[float, float]]:
    return {each.id: each.position_m[:2] for each in fleet.objects(now_ns)}


def test_every_agv_of_the_broker_is_an_object_where_it_said_last() -> None:
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


def test_an_agv_that_drives_is_shown_where_it_is_now_and_not_for_long_without_news() -> None:
    fleet = fleet_of()
    fleet.on_message(topic("visualization"), at(1.0, 0.0), START_NS)
    fleet.on_message(topic("visualization"), at(1.0, 1.0, number=2, vx=0.5), START_NS)
    ((x, y),) = places(fleet, START_NS + NS_PER_S).values()
    assert (x, y) == pytest.approx((1.0, 1.5))
    assert places(fleet, START_NS + 3 * NS_PER_S) == {}


def test_an_agv_that_is_off_on_another_map_or_silent_has_left() -> None:
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


def test_the_number_of_agvs_is_bounded() -> None:
    fleet = fleet_of()
    for serial in range(MAX_AGVS + 9):
        fleet.on_message(topic("visualization", f"{serial}"), at(1.0, 2.0), START_NS)
    assert len(fleet.objects(START_NS)) == MAX_AGVS


@given(st.sampled_from([topic("state"), topic("connection"), "a/b", "////", ""]), st.binary(max_size=99))
def test_no_message_raises(name: str, payload: bytes) -> None:
    assert not fleet_of().on_message(name, payload, START_NS)
