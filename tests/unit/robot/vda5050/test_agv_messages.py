"""Messages of VDA 5050: those of the specification, and whatever a broker may deliver."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.services.robot.drivers.agv_orders import InstantAction, MessageEncoder, Order, OrderNode, Version
from pointit.vda5050 import AgvConnection, AgvState, Visualization, blocked_by, parse

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


def test_a_state_of_the_specification_is_understood() -> None:
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
def test_an_agv_that_takes_no_orders_says_why(change: dict[str, object], sentence: str) -> None:
    state = parse(AgvState, json.dumps({**json.loads(STATE), **change}).encode())
    assert state is not None
    assert blocked_by(state) == sentence


@pytest.mark.parametrize(
    "payload",
    [b"", b"null", b"[" * 100_000, STATE[:-1].encode(), STATE.encode() + b" " * 2_000_000, 7, None],
    ids=lambda payload: str(payload)[:12],
)
def test_what_is_no_message_is_none(payload: object) -> None:
    assert parse(AgvState, payload) is None


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
