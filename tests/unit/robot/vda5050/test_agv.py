"""An AGV by VDA 5050 that is steered: what is sent to it, and what is reported of it."""

import json
import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointit.services.robot.robot_driver import Follow, FollowPath, Stop
from tests.unit.robot.vda5050.agv_bench import AgvBench, connected_bench, orders

FAR = (9.0, 0.0, 0.0)


@pytest.fixture(name="bench")
def _bench() -> AgvBench:
    bench = connected_bench()
    assert bench.lost[-1].startswith("no AGV reports at uagv/v2/acme/7/state on hub: switch it on")
    assert bench.reports[-1].position_m == (0.0, 0.0, 0.0)
    return bench


def test_path_is_released_in_steps_and_driven_without_a_pause(bench: AgvBench) -> None:
    path = bench.tell(FollowPath, ((3.0, 0.0, 0.0), (3.0, 4.0, 0.0)), 1.5)
    bench.run(8.0)
    assert bench.outcomes(path) == [("accepted", ""), ("done", "")]
    assert bench.virtual.place == (3.0, 4.0)
    assert bench.virtual.farthest_base_m <= 1.0 + 1e-6
    sent = orders(bench)
    assert len({order["orderId"] for order in sent}) == 1, "one order, and its updates"
    assert [order["orderUpdateId"] for order in sent] == list(range(len(sent)))
    assert len(sent) <= 2 * 8
    assert not bench.agv.is_active


def test_new_target_follows_the_released_way_unless_it_hardly_differs(bench: AgvBench) -> None:
    bench.tell(Follow, FAR)
    bench.run(2.0)
    for number in range(20):
        bench.tell(Follow, (2.0, 1.0 + 0.004 * number, 0.0))
        bench.run(0.05)
    sent = len(orders(bench))
    bench.run(3.0)
    assert math.dist(bench.virtual.place, (2.0, 1.0)) < 0.11
    assert bench.virtual.farthest_base_m <= 1.0 + 1e-6
    assert sent <= 2 * 3 + 1
    settled = len(orders(bench))
    bench.tell(Follow, (2.0, 1.05, 0.0))
    bench.run(2.0)
    assert len(orders(bench)) == settled


def test_stop_cancels_and_an_idle_agv_is_left_alone(bench: AgvBench) -> None:
    idle = bench.tell(Stop)
    assert bench.outcomes(idle) == [("done", "")]
    bench.tell(FollowPath, (FAR,))
    bench.run(1.0)
    stop = bench.tell(Stop)
    bench.run(0.2)
    assert bench.outcomes(stop) == [("done", "")]
    assert bench.virtual.base == []
    assert bench.topics().count("instantActions") == 2, "the question at the beginning, and the cancellation"
    there = bench.virtual.place
    bench.run(3.0)
    assert bench.virtual.place == there


def test_lost_orders_and_cancellations_are_sent_again(bench: AgvBench) -> None:
    lost: list[str] = []

    def lose_the_first(topic: str) -> bool:
        lost.append(topic)
        return len(lost) <= 1 and topic.endswith(("/order", "/instantActions"))

    bench.is_lossy = lose_the_first
    path = bench.tell(FollowPath, ((1.0, 0.0, 0.0),))
    bench.run(3.0)
    assert bench.outcomes(path)[-1] == ("done", "")
    first, second = orders(bench)[:2]
    assert (first["orderId"], first["orderUpdateId"]) == (second["orderId"], second["orderUpdateId"])
    bench.tell(FollowPath, (FAR,))
    bench.run(0.5)
    lost.clear()
    stop = bench.tell(Stop)
    bench.run(2.0)
    assert bench.outcomes(stop) == [("done", "")]
    assert bench.virtual.base == []


def test_late_answer_to_a_repeated_cancellation_counts(bench: AgvBench) -> None:
    bench.tell(FollowPath, (FAR,))
    bench.run(1.0)
    bench.is_lossy = lambda topic: topic.endswith("/instantActions")
    sent = len(bench.sent)
    stop = bench.tell(Stop)
    bench.run(2.5)
    cancellations = [each for each in bench.sent[sent:] if "cancelOrder" in each[1]]
    assert len(cancellations) == 3
    assert bench.outcomes(stop) == []
    bench.virtual.receive(*cancellations[0])
    bench.run(0.1)
    assert bench.outcomes(stop) == [("done", "")]
    assert not bench.agv.is_active


def test_order_fails_when_unanswered_and_is_cancelled_at_the_answer(bench: AgvBench) -> None:
    bench.is_lossy = lambda topic: topic.endswith(("/order", "/instantActions"))
    path = bench.tell(FollowPath, (FAR,))
    bench.run(7.0)
    assert bench.outcomes(path) == [
        ("failed", "the AGV does not answer: look at its mode and its connection")
    ]
    assert len(orders(bench)) == 5
    bench.run(8.0)
    assert "does not confirm that it stops" in bench.health.warnings["agv"]
    bench.is_lossy = lambda _topic: False
    bench.virtual.receive(*bench.sent[-1])
    bench.run(2.0)
    assert not bench.agv.is_active
    assert "agv" not in bench.health.warnings


def test_refused_order_is_reported_with_the_agvs_reason(bench: AgvBench) -> None:
    bench.virtual.place = (5.0, 5.0)  # carried away, and not yet said
    path = bench.tell(FollowPath, (FAR,))
    for publication in bench.agv.step(bench.now_s + 1.0):
        bench.deliver(publication)
    bench.run(1.0)
    assert bench.outcomes(path) == [("refused", "noRouteError")]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"operatingMode": "MANUAL"}, "mode MANUAL"),
        ({"safetyState": {"eStop": "AUTOACK", "fieldViolation": True}}, "emergency stop"),
        ({"errors": [{"errorType": "wheel", "errorLevel": "FATAL"}]}, "needs help (wheel)"),
    ],
)
def test_agv_that_cannot_drive_is_stopped_and_refuses_orders(
    bench: AgvBench, change: dict[str, object], words: str
) -> None:
    path = bench.tell(FollowPath, (FAR,))
    bench.run(1.0)
    bench.change(**change)
    bench.run(1.0)
    assert bench.virtual.base == [], "it does not drive on when that is over"

    again = bench.tell(Follow, FAR)
    for order in (path, again):
        state, reason = bench.outcomes(order)[-1]
        assert state == "refused"
        assert words in reason
    bench.change()
    bench.run(0.5)
    there = bench.virtual.place

    bench.run(2.0)
    assert bench.virtual.place == there
    bench.tell(Follow, FAR)
    bench.run(2.0)
    assert bench.virtual.place != there


def test_order_that_somebody_else_cancels_ends(bench: AgvBench) -> None:
    path = bench.tell(FollowPath, (FAR,))
    bench.run(1.0)
    bench.virtual.base = []
    bench.virtual.has_changed = True
    bench.run(3.0)
    cancelled = ("cancelled", "it was cancelled at the AGV, or by another master control")
    assert bench.outcomes(path) == [("accepted", ""), cancelled]


def test_order_cancelled_during_its_update_counts_as_cancelled(
    bench: AgvBench,
) -> None:
    path = bench.tell(FollowPath, (FAR,))
    bench.is_lossy = lambda topic: topic.endswith("/order") and len(orders(bench)) == 2
    while len(orders(bench)) < 2:
        bench.run(0.05)
    bench.virtual.base = []
    bench.virtual.receive(*bench.sent[-1])
    assert b"orderUpdateError" in bench.virtual.state()
    bench.virtual.has_changed = True
    bench.is_lossy = lambda _topic: False
    bench.run(1.0)
    assert [state for state, _ in bench.outcomes(path)][-1] == "cancelled"
    assert not bench.agv.is_active


def test_order_from_before_a_lost_link_is_cancelled_afterwards(bench: AgvBench) -> None:
    path = bench.tell(FollowPath, (FAR,))
    bench.run(1.0)
    bench.agv.on_disconnected("the broker is gone")
    assert bench.outcomes(path)[-1] == ("failed", "the connection to the AGV is lost")
    assert bench.lost[-1] == "the broker is gone"
    ended = len(bench.sent)
    bench.run(0.2)
    bench.tell(Follow, FAR)
    bench.run(0.2)
    assert len(bench.sent) == ended
    bench.connect()
    bench.run(2.0)
    assert bench.topics()[ended:] == ["instantActions", "instantActions"], "a question and a cancellation"
    assert bench.virtual.base == []


def test_end_of_the_driver_stops_an_agv_that_moves(bench: AgvBench) -> None:
    assert bench.agv.closing_messages() == []
    bench.tell(FollowPath, (FAR,))
    bench.run(0.5)
    for publication in bench.agv.closing_messages():
        bench.deliver(publication)
    assert bench.virtual.base == []


def test_agv_that_stands_is_reported_ten_times_a_second(
    bench: AgvBench,
) -> None:
    bench.is_lossy = lambda _topic: True
    before = len(bench.reports)
    bench.run(10.0)
    assert 90 <= len(bench.reports) - before <= 101
    assert bench.reports[-1].stamp_ns >= bench.clock.now_ns() - 150_000_000
    assert (bench.reports[-1].battery, bench.reports[-1].velocity_mps) == (0.8, (0.0, 0.0, 0.0))
    bench.run(26.0)
    assert bench.lost[-1] == "the AGV has sent nothing for 35 s: look at its network"


def test_silent_agv_with_an_order_is_asked_for_its_state(bench: AgvBench) -> None:
    bench.tell(FollowPath, (FAR,))
    bench.run(0.5)
    bench.is_lossy = lambda _topic: True
    reported = len(bench.reports)
    sent = len(bench.sent)
    bench.run(3.0)
    assert len(bench.reports) == reported
    questions = [payload for _topic, payload in bench.sent[sent:] if "stateRequest" in payload]
    assert 5 <= len(questions) <= 8


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("connection", {"connectionState": "OFFLINE"}, "switched off (OFFLINE)"),
        ("connection", {"connectionState": "CONNECTIONBROKEN"}, "lost its connection (CONNECTIONBROKEN)"),
        (
            "visualization",
            {"agvPosition": {"x": 0, "y": 0, "theta": 0, "mapId": "hall", "positionInitialized": False}},
            "does not know where it is",
        ),
        (
            "visualization",
            {"agvPosition": {"x": 0, "y": 0, "theta": 0, "mapId": "yard", "positionInitialized": True}},
            "is on map 'yard', and not on 'hall'",
        ),
    ],
)
def test_agv_without_position_or_connection_is_lost_and_returns(
    name: str, change: dict[str, object], words: str
) -> None:
    bench = AgvBench(map_id="hall")
    bench.connect()
    bench.run(0.1)
    path = bench.tell(FollowPath, (FAR,))
    bench.run(0.5)
    bench.hear(name, json.dumps({"headerId": 900, **change}).encode())
    assert words in bench.lost[-1]
    assert bench.outcomes(path)[-1][0] == "failed"
    bench.virtual.drive(0.1)
    bench.run(2.0)
    assert bench.virtual.base == []
    assert bench.reports[-1].position_m[0] > 0.1


def test_messages_of_another_kind_are_said_and_dropped(bench: AgvBench) -> None:
    bench.hear("state", b"{}")
    assert bench.health.warnings["message state"].startswith(
        "uagv/v2/acme/7/state: a message is not one of VDA 5050"
    )
    bench.hear("state", bench.virtual.state())
    assert "message state" not in bench.health.warnings


names = st.sampled_from(["state", "visualization", "connection", "order", ""])
steps = st.lists(
    st.one_of(
        st.tuples(st.just("hear"), names, st.binary(max_size=40)),
        st.tuples(
            st.just("change"), st.sampled_from(["driving", "orderId", "nodeStates"]), st.none() | st.text()
        ),
        st.tuples(st.just("follow"), st.floats(-5, 5), st.floats(-5, 5)),
        st.tuples(st.just("path"), st.floats(-5, 5), st.floats(-5, 5)),
        st.tuples(st.just("stop"), st.none(), st.none()),
        st.tuples(st.just("lose"), st.booleans(), st.booleans()),
        st.tuples(st.just("broker"), st.booleans(), st.none()),
    ),
    max_size=12,
)


@settings(max_examples=60)
@given(steps)
def test_released_way_stays_short_and_a_stop_always_stops(chosen: list[tuple[str, Any, Any]]) -> None:
    bench = AgvBench()
    bench.connect()
    for what, a, b in chosen:
        if what == "hear":
            bench.hear(str(a), b)
        elif what == "change":
            bench.change(**{str(a): b})
        elif what == "follow":
            bench.tell(Follow, (a, b, 0.0))
        elif what == "path":
            bench.tell(FollowPath, ((a, b, 0.0), (b, a, 0.0)))
        elif what == "stop":
            bench.tell(Stop)
        elif what == "lose":
            is_lossy = bool(a)
            bench.is_lossy = lambda _topic, is_lossy=is_lossy: is_lossy
        elif a:
            bench.connect()
        else:
            bench.agv.on_disconnected("gone")
        bench.run(0.4)

    assert bench.virtual.farthest_base_m <= 1.0 + 1e-6
    bench.virtual.extra = {}
    bench.is_lossy = lambda _topic: False
    bench.connect()
    bench.tell(Stop)
    bench.run(2.5)
    assert bench.virtual.base == []
    assert not bench.agv.is_active
    assert len(orders(bench)) <= 2 * (bench.now_s - 100.0) + 1


@pytest.mark.parametrize("connection", ["OFFLINE", "CONNECTIONBROKEN", "ONLINE", ""])
def test_agv_of_a_retained_state_awaits_a_message_before_orders(connection: str) -> None:
    bench = AgvBench()
    bench.connect()
    old = json.loads(bench.virtual.state()) | {"timestamp": "2023-11-13T10:00:00.00Z"}
    retained = {"state": old, "connection": {"timestamp": old["timestamp"], "connectionState": connection}}
    for name in reversed(retained) if connection else ["state"]:
        topic = bench.agv.topic(name)
        bench.agv.on_message(topic, json.dumps(retained[name]).encode(), bench.now_s, is_retained=True)

    bench.is_lossy = lambda _topic: True
    bench.tell(FollowPath, (FAR,))
    bench.run(3.0)
    assert (orders(bench), bench.reports) == ([], [])
    is_off = connection in {"OFFLINE", "CONNECTIONBROKEN"}
    assert (f"({connection})" if is_off else "s old: switch the AGV on") in bench.lost[-1]

    bench.is_lossy = lambda _topic: False
    bench.change()
    bench.run(0.2)
    bench.tell(FollowPath, (FAR,))
    bench.run(1.0)
    assert orders(bench)
