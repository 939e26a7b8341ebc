"""Messages of AGVs: as specified, tolerated, late."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.services.robot.drivers.agv_orders import InstantAction, MessageEncoder, Order, OrderNode, Version
from pointit.vda5050 import AgvConnection, AgvState, TimestampCheck, Visualization, blocked_by, parse

HEADER = """"headerId": 15, "timestamp": "2017-04-15T11:40:03.12Z", "version": "2.0.0",
  "manufacturer": "KIT", "serialNumber": "0001" """
STATE = f"""{{{HEADER}, "orderId": "1234", "orderUpdateId": 1, "zoneSetId": "",
  "lastNodeId": "pumpenhaus_1", "lastNodeSequenceId": 4,
  "nodeStates": [{{"nodeId": "7", "sequenceId": 6, "released": true, "nodePosition": {{"x": 1, "y": 2,
    "theta": 0.0, "allowedDeviationXY": 0, "mapId": "f1"}}}}],
  "edgeStates": [{{"edgeId": "e3", "sequenceId": 5, "released": true}}],
  "agvPosition": {{"positionInitialized": true, "localizationScore": 0.9, "deviationRange": 0.1,
    "x": 1.5, "y": -2.25, "theta": -1.57, "mapId": "f1", "mapDescription": "first floor"}},
  "velocity": {{"vx": 0.5, "vy": 0, "omega": 0.1}}, "loads": [], "driving": true, "paused": false,
  "newBaseRequest": true, "distanceSinceLastNode": 0.2,
  "actionStates": [{{"actionId": "a1", "actionType": "cancelOrder", "actionStatus": "RUNNING"}}],
  "batteryState": {{"batteryCharge": 80, "batteryVoltage": 24.1, "charging": false, "reach": 4000}},
  "operatingMode": "AUTOMATIC", "errors": [], "informations": [{{"infoType": "x", "infoLevel": "DEBUG"}}],
  "safetyState": {{"eStop": "NONE", "fieldViolation": false}}, "vendorField": [1, 2]}}"""
anything = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.just(10**400) | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=9), inner, max_size=3),
    max_leaves=6,
)
state_fields = st.dictionaries(
    st.sampled_from(sorted(json.loads(STATE))) | st.sampled_from(["", "x"]), anything, max_size=4
)


def test_state_of_the_specification_is_understood() -> None:
    state = parse(AgvState, STATE.encode())
    assert state is not None
    assert (state.order_id, state.order_update_id) == ("1234", 1)
    assert (state.last_node_id, state.last_node_sequence_id) == ("pumpenhaus_1", 4)
    assert state.is_executing
    assert state.agv_position is not None
    position = state.agv_position
    assert (position.x, position.y, position.theta, position.map_id) == (1.5, -2.25, -1.57, "f1")
    assert position.deviation_range == 0.1
    assert state.velocity is not None
    assert state.velocity.vx == 0.5
    assert [(each.action_id, each.action_status) for each in state.action_states] == [("a1", "RUNNING")]
    assert (state.charge, state.driving, blocked_by(state)) == (80.0, True, "")
    assert state.unreadable == {}


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"operatingMode": "SERVICE"}, "the AGV is in mode SERVICE: switch it to AUTOMATIC"),
        (
            {"safetyState": {"eStop": "MANUAL", "fieldViolation": False}},
            "the emergency stop of the AGV is active: release it at the vehicle",
        ),
        (
            {"errors": [{"errorType": "dirty", "errorLevel": "FATAL", "errorDescription": "laser\n 1"}]},
            "the AGV needs help (dirty: laser 1): look after it",
        ),
        ({"errors": [{"errorType": "dusty", "errorLevel": "WARNING"}]}, ""),
    ],
)
def test_agv_that_takes_no_orders_says_why(change: dict[str, object], sentence: str) -> None:
    state = parse(AgvState, json.dumps({**json.loads(STATE), **change}).encode())
    assert state is not None
    assert blocked_by(state) == sentence


@pytest.mark.parametrize(
    "payload",
    [
        *(b"", b"null", b"[" * 100_000, STATE[:-1].encode(), STATE.encode() + b" " * 2_000_000, 7, None),
        *(b"\xef\xbb\xbf{}", "Bär".encode("latin-1"), b"{}", b'{"state": "ON"}', b'"ON"', b"[]", b"21.5"),
    ],
    ids=lambda payload: str(payload)[:12],
)
def test_payload_that_is_no_message_is_none(payload: object) -> None:
    assert parse(AgvState, payload) is None
    assert parse(Visualization, payload) is None


@given(st.binary(max_size=200) | anything.map(lambda each: json.dumps(each).encode()))
def test_no_payload_raises(payload: bytes) -> None:
    for kind in (AgvConnection, AgvState, Visualization):
        parse(kind, payload)


@given(state_fields)
def test_no_state_with_wrong_fields_raises(fields: dict[str, object]) -> None:
    state = parse(AgvState, json.dumps({**json.loads(STATE), **fields}).encode())
    if state is not None:
        assert len(blocked_by(state)) < 1000


def written_node(number: int, **place: float) -> dict[str, object]:
    position = {**place, "mapId": "f1"}
    node = {"nodeId": f"o.{number}", "sequenceId": number, "nodePosition": position}
    return {**node, "released": True, "actions": []}


@pytest.mark.parametrize("version", ["1.1.0", "2.0.0"])
def test_orders_and_actions_are_written_as_the_specification_wants(version: Version) -> None:
    letterhead = MessageEncoder("uagv", version, "KIT", "0001", lambda: 1_492_256_403_120_000_000)
    order = Order("o", 1, (OrderNode(2, 0.5, 0.0), OrderNode(4, 1.0, 0.123456, theta=1.5)), 0.5)
    topic, payload = letterhead.order(order, "f1")
    header = {
        "headerId": 0,
        "timestamp": "2017-04-15T11:40:03.12Z",
        "version": version,
        "manufacturer": "KIT",
        "serialNumber": "0001",
    }

    assert topic == f"uagv/v{version[0]}/KIT/0001/order"
    edge = {"edgeId": "o.3", "sequenceId": 3, "startNodeId": "o.2", "endNodeId": "o.4", "maxSpeed": 0.5}
    assert json.loads(payload) == {
        **header,
        "orderId": "o",
        "orderUpdateId": 1,
        "nodes": [written_node(2, x=0.5, y=0.0), written_node(4, x=1.0, y=0.1235, theta=1.5)],
        "edges": [{**edge, "released": True, "actions": []}],
    }

    action = {"actionType": "cancelOrder", "actionId": "c", "blockingType": "NONE"}
    topic, payload = letterhead.actions([InstantAction("cancelOrder", "c")])
    assert topic == f"uagv/v{version[0]}/KIT/0001/instantActions"

    names = ("instantActions",) if version[0] == "1" else ("instantActions", "actions")
    assert json.loads(payload) == {**header, **{key: [action] for key in names}}
    _, second = letterhead.actions([InstantAction("cancelOrder", "d")])
    assert json.loads(second)["headerId"] == 1, "counted by topic"


PLACE: dict[str, Any] = {"x": 4.0, "y": -2.0, "theta": 1.2, "mapId": "f2", "positionInitialized": True}
IDLE: dict[str, Any] = {
    "headerId": 41,
    "timestamp": "2026-03-02T08:15:00.250Z",
    "version": "2.1.0",
    "manufacturer": "Nordlicht",
    "serialNumber": "T-12",
    "orderId": "",
    "orderUpdateId": 0,
    "lastNodeId": "",
    "lastNodeSequenceId": 0,
    "nodeStates": [],
    "edgeStates": [],
    "actionStates": [],
    "driving": False,
    "agvPosition": PLACE,
    "batteryState": {"batteryCharge": 63.5, "charging": False},
    "operatingMode": "AUTOMATIC",
    "errors": [],
    "safetyState": {"eStop": "NONE", "fieldViolation": False},
}
NONE: set[str] = set()


def state(*missing: str, **change: object) -> AgvState:
    """Return the message with fields changed or missing; it must be understood."""
    fields = {name: value for name, value in {**IDLE, **change}.items() if name not in missing}
    parsed = parse(AgvState, json.dumps(fields).encode())
    assert parsed is not None
    return parsed


def place(**change: object) -> dict[str, object]:
    return {"agvPosition": {**PLACE, **change}}


@pytest.mark.parametrize(
    ("change", "names"),
    [
        ({"errors": None, "actionStates": None, "nodeStates": None}, NONE),  # empty slices of Go
        ({"orderId": None, "lastNodeId": None, "velocity": None, "paused": None}, NONE),
        ({"velocity": {"vx": None, "vy": None, "omega": None}}, NONE),
        ({"batteryState": {"batteryCharge": None}}, NONE),
        (place(mapId=None, deviationRange=None), NONE),
        ({"headerId": "41", "lastNodeSequenceId": 0.0}, NONE),
        ({"orderUpdateId": "0", "velocity": {"vx": "0"}}, {"orderUpdateId", "vx"}),
        (place(mapId=3), {"mapId"}),
        ({"headerId": 1_767_000_000_000}, NONE),  # a time in ms
        ({"timestamp": "2026-03-02T08:15:00.250"}, NONE),
        ({"timestamp": "2026-03-02 09:15:00,25+01:00"}, NONE),
        ({"timestamp": 1_772_439_300_250}, {"timestamp"}),
        ({"errors": {}, "actionStates": {}}, {"errors", "actionStates"}),  # empty tables of Lua
        (place(positionInitialized=False, x=4.0, y=-2.0, theta=None), NONE),
        ({"zoneSets": [], "instantActionStates": [], "plannedPath": {"trajectory": {}}}, NONE),
        ({"batteryState": {"batteryCharge": -1}}, {"batteryCharge"}),
        ({"batteryState": "full"}, {"batteryState"}),
        (place(theta=93.0), {"theta"}),  # degrees
        ({"timestamp": 10**400}, {"timestamp"}),
        ({"lastNodeSequenceId": -1}, {"lastNodeSequenceId"}),
        ({"driving": "perhaps"}, {"driving"}),
        (
            {"actionStates": [{"actionId": "a"}, {"actionId": "b", "actionStatus": "FINISHED"}]},
            {"actionStatus"},
        ),
        ({"errors": ["E 17"]}, {"errors"}),
        ({"errors": [{"errorType": "x", "errorLevel": "SEVERE"}]}, {"errorLevel"}),
        ({"safetyState": None}, {"safetyState"}),
        ({"safetyState": {"eStop": None}}, {"eStop"}),
    ],
)
def test_unreadable_field_is_reported_and_all_others_are_used(
    change: dict[str, object], names: set[str]
) -> None:
    parsed = state(**change)
    assert set(parsed.unreadable) == names
    assert parsed.agv_position is not None
    assert (parsed.agv_position.x, parsed.agv_position.y) == (4.0, -2.0)
    assert not parsed.is_executing


def test_long_value_is_shortened_visibly() -> None:
    assert state(timestamp="x" * 99).unreadable["timestamp"] == f"is '{'x' * 38}…"


def test_unreadable_item_of_a_list_leaves_the_others() -> None:
    parsed = state(actionStates=[7, {"actionId": "b", "actionStatus": "FINISHED"}, {}])
    assert [(each.action_id, each.action_status) for each in parsed.action_states] == [("b", "FINISHED")]
    parsed = state(errors=[None, {"errorType": "wheel", "errorLevel": "fatal"}])
    assert [each.error_type for each in parsed.errors] == ["wheel"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"safetyState": None}, "eStop"),
        ({"safetyState": {}}, "eStop"),
        ({"safetyState": {"eStop": None}}, "eStop"),
        ({"safetyState": {"eStop": ""}}, "eStop"),
        ({"safetyState": {"eStop": ["NONE"]}}, "eStop"),
        ({"safetyState": {"eStop": "OK"}}, "eStop is OK"),
        ({"safetyState": {"eStop": "AUTOACK"}}, "emergency stop of the AGV is active"),
        ({"safetyState": {"eStop": "none"}}, "eStop is none"),
        ({"operatingMode": None}, "operatingMode"),
        ({"operatingMode": "ECO"}, "mode ECO"),
        ({"operatingMode": "Automatic"}, "mode Automatic"),
        ({"errors": "wheel"}, "errors"),
        ({"errors": ["wheel"]}, "errors"),
        ({"errors": [{"errorType": "wheel", "errorLevel": "fatal"}]}, "wheel"),
        ({"errors": [{"errorType": "wheel", "errorLevel": "SEVERE"}]}, "wheel"),
        ({"errors": [{"errorType": "wheel"}]}, r"without errorLevel, which may be FATAL (wheel)"),
        ({"errors": [{"errorType": "wheel", "errorLevel": ""}]}, "without errorLevel"),
        ({"errors": [{"errorType": "ok", "errorLevel": "WARNING"}, {"errorType": "arm"}]}, "FATAL (arm)"),
    ],
)
def test_safety_that_cannot_be_read_never_counts_as_safe(change: dict[str, object], words: str) -> None:
    assert words in blocked_by(state(**change))


@pytest.mark.parametrize(
    "change",
    [
        {"safetyState": {"activeEmergencyStop": "NONE"}},  # 3.0
        {"operatingMode": "SEMIAUTOMATIC"},
        {"errors": [{"errorType": "x", "errorLevel": "URGENT"}]},  # 3.0
        {"errors": [{"errorLevel": "WARNING", "errorDescription": None}]},
        {"errors": None},
    ],
)
def test_names_and_words_of_version_3_are_understood(change: dict[str, object]) -> None:
    assert blocked_by(state(**change)) == ""


@pytest.mark.parametrize("is_localized", [True, False])
@pytest.mark.parametrize(
    "old", [{"agvPosition": None, "batteryState": None}, {}], ids=["empty fields of version 2", "none"]
)
def test_names_of_version_3_are_those_of_version_2(old: dict[str, object], *, is_localized: bool) -> None:
    where = {"x": 1.5, "y": 2.5, "theta": 0.5, "mapId": "hall", "localized": is_localized}
    new = {"mobileRobotPosition": where, "powerSupply": {"stateOfCharge": 40.0}}
    parsed = state(*{"agvPosition", "batteryState"} - old.keys(), **old, **new)
    assert parsed.agv_position is not None
    assert (parsed.agv_position.x, parsed.agv_position.position_initialized) == (1.5, is_localized)
    assert (parsed.charge, parsed.unreadable) == (40.0, {})


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"nodeStates": None, "driving": True}, True),
        ({"nodeStates": "two", "driving": True}, True),
        ({"nodeStates": None, "driving": None}, True),
        ({"nodeStates": None, "driving": False}, False),
        ({"nodeStates": [None]}, True),
        ({"nodeStates": [{"nodeId": None, "sequenceId": "x"}]}, True),
    ],
)
def test_agv_with_unreadable_nodes_is_idle_only_when_reported_standing(
    change: dict[str, object], expected: object
) -> None:
    assert state(**change).is_executing == expected


NOWHERE: dict[str, Any] = {"x": None, "y": None, "theta": None}


@pytest.mark.parametrize(
    ("where", "is_valid", "fault"),
    [
        pytest.param({**NOWHERE, "positionInitialized": False}, False, None, id="denied, and not stated"),
        pytest.param({**NOWHERE, "localized": False}, False, None, id="denied as in version 3"),
        *(
            pytest.param(
                {**NOWHERE, "mapId": "", "positionInitialized": flag, "localized": False}, False, None
            )
            for flag in (True, None)
        ),
        *(
            pytest.param({**PLACE, "positionInitialized": flag}, False, f"is {flag!r}", id=f"flag {flag!r}")
            for flag in ("perhaps", 2, [], {})
        ),
        pytest.param({**PLACE, "positionInitialized": None}, None, "is missing", id="flag empty"),
        pytest.param({"x": 1.0, "y": 2.0, "theta": 0.0, "mapId": "f2"}, None, "is missing", id="no flag"),
    ],
)
def test_position_counts_unless_a_readable_field_denies_it(
    where: dict[str, object], is_valid: object, fault: str | None
) -> None:
    parsed = state(agvPosition=where)
    assert parsed.agv_position is not None
    assert parsed.agv_position.position_initialized is is_valid
    assert parsed.unreadable == ({} if fault is None else {"positionInitialized": fault})


def test_charge_that_may_be_a_share_is_reported() -> None:
    parsed = state(batteryState={"batteryCharge": 0.83})
    assert (parsed.charge, parsed.unreadable) == (None, {"batteryCharge": "is 0.83"})
    charges = [
        state(batteryState={"batteryCharge": charge}).charge for charge in (0, 1, 1.5, "57", -1, 100.4)
    ]
    assert charges == [0.0, 1.0, 1.5, None, None, None]


@pytest.mark.parametrize("where", [{"x": "here"}, {"x": None}, {"y": 1e9}])
def test_position_without_a_coordinate_is_none_in_a_usable_state(
    where: dict[str, object],
) -> None:
    parsed = state(**place(**where))
    assert parsed.agv_position is None
    assert set(parsed.unreadable) == set(where)
    assert parsed.charge == 63.5


@pytest.mark.parametrize(
    ("written", "unreadable"),
    [
        *((word, set()) for word in ("ONLINE", "CONNECTIONBROKEN", "CONNECTION_BROKEN", "HIBERNATING")),
        *((word, {"connectionState"}) for word in ("UP", "online", "", None, [])),
    ],
)
def test_connection_words_beyond_the_standard_are_reported(written: object, unreadable: set[str]) -> None:
    header = {"serialNumber": "7"} if unreadable else {"headerId": None}
    connection = parse(AgvConnection, json.dumps({**header, "connectionState": written}).encode())
    assert connection is not None
    assert set(connection.unreadable) == unreadable
    assert unreadable or connection.connection_state == written


@pytest.mark.parametrize(
    ("stamps_s", "expected"),
    [
        ([1.0, 2.0, 1.5, 2.0, 3.0], [True, True, False, True, True]),
        ([1.0, 1.0, 2.0, 2.0], [True] * 4),  # a clock of whole seconds
        ([None] * 3, [True] * 3),
        ([5.0, None, 4.0], [True] * 3),
        ([9000.0, 9001.0, 3.0, 4.0], [True] * 4),  # its clock is set back
    ],
)
def test_late_messages_are_ignored_and_no_clock_freezes_an_agv(
    stamps_s: list[float | None], expected: list[bool]
) -> None:
    check = TimestampCheck()
    assert [check.is_new(each) for each in stamps_s] == expected


def test_any_message_is_new_after_a_restart() -> None:
    check = TimestampCheck()
    check.is_new(5.0)
    check.forget()
    assert check.is_new(4.0)
