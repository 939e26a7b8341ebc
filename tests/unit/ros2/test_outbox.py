"""Output to ROS, by a table like the real one; the rate limit of a route."""

import asyncio
import dataclasses
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.outbound.table import CLOCK_S
from pointit.bridges.ros2.routing.rate_limiter import RateLimiter
from pointit.bridges.ros2.routing.routes import Routes, routes
from pointit.runtime.bus.site_clock import SILENT_NS
from pointit.schemas import NS_PER_S, ButtonEvent, ClockTick, Interaction, PointingRay, Selection, UserPose
from pointit.schemas.topics import BUTTON, CLOCK, INTERACTION, POSE, RAY, SELECTION
from tests.support.bench import START_NS, until
from tests.unit.ros2.graph_of_one import Bench, Writer, bench
from tests.unit.ros2.scenes import jazzy

RAY_ROS = "/anna/pointing_ray"
RAY_TYPE = "geometry_msgs/msg/PoseStamped"


def ray(count: int) -> PointingRay:
    return PointingRay(
        stamp_ns=START_NS + count, seq=count, origin_m=(0.0, 0.0, 1.6), direction=(1.0, 0.0, 0.0)
    )


def take(bridge: Bench, topic: object, message: object, name: str = "anna") -> None:
    bridge.scene.take(name, message, bridge.clock.now_ns())  # pyrefly: ignore[bad-argument-type]  # a test's shorthand
    bridge.outbox.take(topic, message, name)  # pyrefly: ignore[bad-argument-type]  # likewise


async def test_unread_messages_are_not_converted(bridge: Bench) -> None:
    bridge.outbox.join("anna")
    take(bridge, RAY, ray(1))
    assert bridge.heard(RAY_ROS, RAY_TYPE) == []
    bridge.look(("subscriber", RAY_ROS))
    take(bridge, RAY, ray(2))
    await until(lambda: bool(bridge.heard(RAY_ROS, RAY_TYPE)))
    (seen,) = bridge.heard(RAY_ROS, RAY_TYPE)
    assert seen.header.frame_id == "anna/human_footprint"
    assert seen.header.stamp.nanosec == (START_NS + 2) % 10**9


async def test_route_is_notified_of_its_first_reader(monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[int] = []
    rows = [
        dataclasses.replace(row, begins=lambda: begun.append(1))
        for row in routes().outward
        if row.name == "pointing_ray"
    ]
    async with bench(jazzy(), dataclasses.replace(routes(), outward=tuple(rows))) as bridge:
        bridge.outbox.join("anna")
        monkeypatch.setattr(Writer, "is_read", True)  # by a node that the graph does not show
        take(bridge, RAY, ray(1))
        assert len(bridge.heard(RAY_ROS, RAY_TYPE)) == 1
        assert not begun

        bridge.look()
        bridge.look()
        assert begun == [1]


async def test_newest_message_is_sent_when_they_come_too_fast(eager: Bench) -> None:
    for count in range(200):
        take(eager, RAY, ray(count))
    await until(lambda: len(eager.backend.sent[RAY_ROS]) == 2)
    first, last = eager.heard(RAY_ROS, RAY_TYPE)
    assert (first.header.stamp.nanosec, last.header.stamp.nanosec) == (
        START_NS % 10**9,
        (START_NS + 199) % 10**9,
    )


def slowed(name: str, rate_hz: float) -> Routes:
    table = routes()
    rows = [
        dataclasses.replace(row, rate_hz=rate_hz, repeat_hz=None) for row in table.outward if row.name == name
    ]
    return dataclasses.replace(table, outward=tuple(rows))


async def test_rate_limit_keeps_the_newest_message_of_each_person() -> None:
    people = ("anna", "ben", "cleo")
    async with bench(jazzy(), slowed("tf", 20.0), is_read=True) as bridge:
        for seq in range(3):
            for user in people:
                at_m = (float(seq), 0.0, 0.0)
                take(bridge, POSE, UserPose(stamp_ns=START_NS, seq=seq, position_m=at_m, yaw_rad=0.0), user)

        def last() -> dict[str, float]:
            values = bridge.heard("/tf", "tf2_msgs/msg/TFMessage")
            sent = [transform for value in values for transform in value.transforms]
            return {each.child_frame_id.partition("/")[0]: each.transform.translation.x for each in sent}

        await until(lambda: last() == dict.fromkeys(people, 2.0))


def waiting(bridge: Bench, route: str) -> list[str]:
    return [name for _, name in bridge.outbox._lines[route, ""]._waiting.values()]


@pytest.mark.parametrize(("route", "left"), [("tf", ["ben", "cleo"]), ("markers", ["cleo"])])
async def test_rate_limit_applies_once_to_a_message_about_everybody(route: str, left: list[str]) -> None:
    async with bench(jazzy(), slowed(route, 0.05), is_read=True) as bridge:
        for user in ("anna", "ben", "cleo"):
            pose = UserPose(stamp_ns=START_NS, seq=1, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0)
            take(bridge, POSE, pose, user)
        assert waiting(bridge, route) == left
        bridge.outbox.leave("ben")
        assert waiting(bridge, route) == ["cleo"], "nothing of who leaves"


async def test_publishers_of_a_person_end_when_they_leave(bridge: Bench) -> None:
    bridge.outbox.join("anna")
    names = {name for name in bridge.backend.writers if name.startswith("/anna/")}
    assert len(names) == sum("{user}" in route.ros for route in routes().outward)
    bridge.outbox.leave("anna")
    assert not any(name.startswith("/anna/") for name in bridge.backend.writers)


async def test_a_transform_is_repeated_with_the_time_it_is_then(bridge: Bench) -> None:
    bridge.look(("subscriber", "/tf"))
    pose = UserPose(stamp_ns=START_NS, seq=1, position_m=(1.0, 2.0, 0.0), yaw_rad=0.5)
    take(bridge, POSE, pose)
    bridge.clock.advance(3.0)
    await until(lambda: len(bridge.backend.sent["/tf"]) >= 2)
    first, again = bridge.heard("/tf", "tf2_msgs/msg/TFMessage")[:2]
    assert again.transforms[0].header.stamp.sec == first.transforms[0].header.stamp.sec + 3
    bridge.outbox.leave("anna")
    count = len(bridge.backend.sent["/tf"])
    await asyncio.sleep(0.25)  # two periods: nothing to wait for
    assert len(bridge.backend.sent["/tf"]) == count


async def test_clock_repetitions_end_with_the_clock_of_the_site() -> None:
    table = routes()
    short = [dataclasses.replace(row, repeat_for_s=0.1) for row in table.outward if row.name == "clock"]
    assert CLOCK_S * NS_PER_S == SILENT_NS, "ROS and the site agree on when a clock has ended"
    assert [row.repeat_for_s for row in table.outward if row.name == "clock"] == [CLOCK_S]

    async with bench(jazzy(), dataclasses.replace(table, outward=tuple(short)), is_read=True) as bridge:
        take(bridge, CLOCK, ClockTick(stamp_ns=START_NS, seq=1, sim_ns=START_NS, speed=2.0), "")
        await until(lambda: len(bridge.backend.sent["/clock"]) > 1)
        await asyncio.sleep(0.2)  # it ends meanwhile
        count = len(bridge.backend.sent["/clock"])
        await asyncio.sleep(0.1)  # five periods: nothing to wait for
        assert len(bridge.backend.sent["/clock"]) == count

        take(bridge, CLOCK, ClockTick(stamp_ns=START_NS, seq=2, sim_ns=START_NS, speed=2.0), "")
        await until(
            lambda: len(bridge.backend.sent["/clock"]) > count + 1, what="the next one to be repeated"
        )


async def test_unchanged_values_are_sent_once_and_again_after_a_return(bridge: Bench) -> None:
    def told() -> list[tuple[str, bool]]:
        wishes = bridge.heard("/PUI_subscription", "conveyor_msgs/msg/PUISubscription")
        return [(each.user_name, each.subscribe) for each in wishes]

    def say(user: str, state: str) -> None:
        take(bridge, INTERACTION, Interaction(stamp_ns=START_NS, seq=1, state=state), user)  # pyrefly: ignore[bad-argument-type]  # one of them

    for count in range(3):
        say("anna", "pointing")
        say("ben", "idle")
        take(bridge, SELECTION, Selection(stamp_ns=START_NS + count, seq=count), "")
    assert told() == [("anna", True), ("ben", False)]
    assert len(bridge.backend.sent["/selected_packages"]) == 1
    say("ben", "pointing")
    assert told()[2:] == [("ben", True)]
    assert len(bridge.backend.sent["/ben/state_transition"]) == 2
    bridge.outbox.leave("anna")
    say("anna", "pointing")
    assert told()[3:] == [("anna", True)]


@pytest.mark.parametrize(("gesture", "presses"), [("press", 1), ("double", 2)])
async def test_a_press_goes_down_and_up(bridge: Bench, gesture: Any, presses: int) -> None:
    take(bridge, BUTTON, ButtonEvent(stamp_ns=START_NS, seq=1, gesture=gesture))
    ros = "/anna/metawear_ros/button"
    assert len(bridge.backend.sent[ros]) == 1, "it is down for a while"
    await until(lambda: len(bridge.backend.sent[ros]) == 2 * presses)
    assert [value.data for value in bridge.heard(ros, "std_msgs/msg/Bool")] == [True, False] * presses


async def test_names_that_others_publish_are_left_to_them(bridge: Bench) -> None:
    bridge.look(("publisher", "/packages"), ("publisher", RAY_ROS))
    bridge.outbox.join("anna")
    assert "/packages" not in bridge.backend.writers
    assert RAY_ROS in bridge.backend.writers, "only what yields does"
    bridge.look()
    assert "/packages" not in bridge.backend.writers, "they may be back at once"
    bridge.look(("publisher", "/packages"))
    bridge.look()
    await until(lambda: "/packages" in bridge.backend.writers)


async def test_one_of_two_yielding_bridges_returns() -> None:
    async with bench(jazzy()) as one, bench(jazzy()) as two:

        def settle() -> bool:
            there = ["/packages" in each.backend.writers for each in (one, two)]
            for each, is_given in ((one, there[1]), (two, there[0])):
                if is_given:
                    each.look(("publisher", "/packages"))
                else:
                    each.look()
            return sum(there) == 1

        assert not settle()
        await until(settle)
        for _ in range(3):
            assert settle()


async def test_unencodable_message_is_reported_and_later_ones_are_sent(eager: Bench) -> None:
    bad = ray(1).model_copy(update={"origin_m": ("here", 0.0, 0.0)})
    take(eager, RAY, bad)
    assert any(RAY_ROS in warning for warning in eager.warnings())
    await asyncio.sleep(0)
    take(eager, RAY, ray(2))
    await until(lambda: len(eager.heard(RAY_ROS, RAY_TYPE)) == 1)
    assert not eager.warnings()
    take(eager, RAY, bad)
    await until(lambda: bool(eager.warnings()))
    eager.outbox.leave("anna")
    assert not eager.warnings(), "what was about her"


def test_a_source_of_the_same_rate_is_never_held_up() -> None:
    pace = RateLimiter(50.0)
    for count in range(1000):
        now_s = 7.0 + count * 0.02 + (0.002 if count % 2 else -0.002)  # jitter of a tenth
        assert pace.wait_s(now_s) == 0.0
        pace.sent(now_s)


@given(st.lists(st.floats(0.0, 0.05), min_size=200, max_size=400))
def test_mean_rate_never_exceeds_the_limit(gaps_s: list[float]) -> None:
    pace = RateLimiter(20.0)
    now_s = 100.0
    sent = 0
    for gap_s in gaps_s:
        now_s += gap_s
        if pace.wait_s(now_s) == 0.0:
            pace.sent(now_s)
            sent += 1
    assert sent <= (now_s - 100.0) * 20.0 + 2.0
