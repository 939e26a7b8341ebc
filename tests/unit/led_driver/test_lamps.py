"""Lamps: the angle of the ray, the targets of people who localize, few flashes."""

import math
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from pointit.geometry.colormap import colormap
from pointit.schemas import NS_PER_S, Cursor, Environment, Lamp, LampLeases, LampMiss, Localization
from pointit.schemas.codec import decode, encode
from pointit.services.led_driver.config import LampsConfig, LedDriverConfig
from pointit.services.led_driver.lamps import DARK, MAX_PEOPLE, TARGET, FlashGuard, LampQueue
from pointit.services.led_driver.light_state import LightState
from tests.unit.led_driver.stage import NOW_NS, Color

VIRIDIS = colormap("viridis")
MS = NS_PER_S // 1000


def lights(lamps: str = "") -> LightState:
    shining = LightState(LedDriverConfig())
    shining.on_map(room(lamps))
    return shining


def room(lamps: str) -> Environment:
    places = tuple(Lamp(id=lamp, position_m=(0.0, 0.0, 1.0)) for lamp in lamps)
    return Environment(stamp_ns=0, name="room", lamps=places)


def cursor(**misses_deg: float) -> Cursor:
    lamps = tuple(LampMiss(id=name, miss_rad=math.radians(miss)) for name, miss in misses_deg.items())
    return Cursor(stamp_ns=NOW_NS, lamps=lamps)


def localization(target_id: str = "", lamps: Sequence[str] = (), **more: Any) -> Localization:
    return Localization(stamp_ns=NOW_NS, phase="sampling", target_id=target_id, lamps=tuple(lamps), **more)


ENDED = Localization(stamp_ns=NOW_NS, phase="solved")


def test_lamps_are_coloured_by_the_angle_to_the_ray() -> None:
    shining = lights(lamps="abc")
    assert not shining.lamps.follow_people
    shining.on_cursor("anna", cursor(a=0.0, b=15.0, c=99.0), NOW_NS)
    assert shining.lamps.follow_people
    assert shining.lamps.colors(NOW_NS) == {
        "a": VIRIDIS.rgb(1.0), "b": VIRIDIS.rgb(0.5), "c": VIRIDIS.rgb(0.0)
    }  # fmt: skip


def test_lamp_has_the_colour_of_the_nearest_ray() -> None:
    shining = lights(lamps="ab")
    shining.on_cursor("anna", cursor(a=15.0, b=0.0), NOW_NS)
    shining.on_cursor("ben", cursor(a=0.0), NOW_NS)
    assert shining.lamps.colors(NOW_NS) == {"a": VIRIDIS.rgb(1.0), "b": VIRIDIS.rgb(1.0)}
    shining.on_cursor("anna", cursor(), NOW_NS)
    assert shining.lamps.colors(NOW_NS)["b"] == VIRIDIS.rgb(0.0)


def test_lamps_go_dark_at_a_known_time_when_nobody_points() -> None:
    shining = lights(lamps="a")
    shining.on_cursor("anna", cursor(a=0.0), NOW_NS)
    shining.lamps.colors(NOW_NS)
    end_ns = shining.lamps.next_change_ns()
    assert end_ns == NOW_NS + 500 * MS
    assert shining.lamps.colors(end_ns) == {"a": DARK}
    assert shining.lamps.next_change_ns() is None


def test_new_map_leaves_no_lamp_lit() -> None:
    shining = lights(lamps="ab")
    shining.on_cursor("anna", cursor(a=0.0, b=0.0), NOW_NS)
    assert shining.lamps.colors(NOW_NS) == {"a": VIRIDIS.rgb(1.0), "b": VIRIDIS.rgb(1.0)}
    shining.on_map(room("b"))
    assert shining.lamps.colors(NOW_NS) == {"a": DARK, "b": VIRIDIS.rgb(1.0)}
    end_ns = shining.lamps.next_change_ns()
    assert end_ns is not None
    assert shining.lamps.colors(end_ns) == {"a": DARK, "b": DARK}


def test_lamps_that_are_not_in_the_map_are_ignored() -> None:
    shining = lights(lamps="b")
    shining.on_cursor("anna", cursor(a=0.0), NOW_NS)
    shining.lamps.queue.on_localization("ben", localization("c", "c"), NOW_NS)
    assert shining.lamps.colors(NOW_NS) == {"b": DARK}


def test_while_anybody_localizes_only_their_targets_are_lit() -> None:
    shining = lights(lamps="abc")
    assert set(shining.lamps.colors(NOW_NS).values()) == {DARK}  # what another instance left lit
    shining.on_cursor("anna", cursor(a=0.0), NOW_NS)
    shining.lamps.queue.on_localization("ben", localization(lamps="ab", ahead=("cleo",)), NOW_NS)  # waits
    assert shining.lamps.colors(NOW_NS) == {"a": VIRIDIS.rgb(1.0), "b": DARK, "c": DARK}
    shining.lamps.queue.on_localization("ben", localization("a", "ab"), NOW_NS)
    shining.lamps.queue.on_localization("cleo", localization("c", "c"), NOW_NS)
    assert shining.lamps.colors(NOW_NS) == {"a": TARGET, "b": DARK, "c": TARGET}
    shining.lamps.queue.on_localization("ben", localization("b", "ab"), NOW_NS)
    shining.lamps.queue.on_localization("cleo", ENDED, NOW_NS)
    assert shining.lamps.colors(NOW_NS) == {"a": DARK, "b": TARGET, "c": DARK}
    shining.lamps.queue.leave("ben")
    assert shining.lamps.colors(NOW_NS) == {"a": VIRIDIS.rgb(1.0), "b": DARK, "c": DARK}


@pytest.mark.parametrize(("by_lamps", "silence_s"), [(True, 3.0), (False, 60.0)])
def test_lamps_are_free_again_when_a_localization_falls_silent(*, by_lamps: bool, silence_s: float) -> None:
    """Silence: by lamps people say each second that they go on. A robot may stand still for long."""
    shining = lights(lamps="ab")
    shining.lamps.queue.on_localization(
        "ben", localization("b", "b") if by_lamps else localization("robot"), NOW_NS
    )
    later_ns = NOW_NS + round(silence_s * NS_PER_S)
    assert shining.lamps.next_change_ns() == later_ns
    shining.on_cursor("anna", cursor(a=0.0), later_ns - MS)
    assert shining.lamps.colors(later_ns - MS)["a"] == DARK
    assert shining.lamps.colors(later_ns) == {"a": VIRIDIS.rgb(1.0), "b": DARK}


def test_unknown_colormaps_are_refused() -> None:
    with pytest.raises(ValidationError, match="there is no colormap 'rainbow'"):
        LampsConfig(colormap="rainbow")


def flashes_in_a_second(shown: list[tuple[int, float]]) -> int:
    """Return the most pairs of opposing changes by a tenth or more within any second."""
    turns_ns: list[int] = []
    extreme = 0.0
    rising = False
    for at_ns, value in shown:
        if rising == (value > extreme):
            extreme = value
        elif abs(value - extreme) >= 0.1:
            turns_ns.append(at_ns)
            extreme = value
            rising = not rising
    most = max((sum(start <= at < start + NS_PER_S for at in turns_ns) for start in turns_ns), default=0)
    return most // 2


def signals(color: Color) -> list[float]:
    red, green, blue = (value / 255 for value in color)
    return [red, green, blue, 0.2126 * red + 0.7152 * green + 0.0722 * blue]


bytes_ = st.integers(0, 255)
wild = st.lists(st.tuples(st.integers(1, 300), st.tuples(bytes_, bytes_, bytes_)), min_size=5, max_size=120)


@example([(20, (255, 255, 255) if number % 2 else DARK) for number in range(120)])
@given(wild)
def test_no_lamp_flashes_more_than_three_times_a_second(changes: list[tuple[int, Color]]) -> None:
    guard = FlashGuard()
    now_ns = NOW_NS
    shown: list[tuple[int, Color]] = []
    for wait_ms, color in changes:
        now_ns += wait_ms * MS
        shown.append((now_ns, guard.show(color, now_ns)))
    for signal in range(4):
        assert flashes_in_a_second([(at_ns, signals(color)[signal]) for at_ns, color in shown]) <= 3
    # what was held back is shown a second later at the latest
    assert guard.show(changes[-1][1], now_ns + NS_PER_S) == changes[-1][1]


def test_colour_held_back_is_shown_a_second_after_earlier_changes() -> None:
    guard = FlashGuard()
    turns = [0, 100, 200, 350, 500]
    for number, turn_ms in enumerate(turns):
        color = DARK if number % 2 else (255, 255, 255)
        assert guard.show(color, NOW_NS + turn_ms * MS) == color
    assert guard.show(DARK, NOW_NS + 600 * MS) == (255, 255, 255)
    assert guard.free_ns == NOW_NS + 1000 * MS
    assert guard.show(DARK, NOW_NS + 999 * MS) == (255, 255, 255)
    assert guard.show(DARK, NOW_NS + 1000 * MS) == DARK
    assert guard.show((255, 255, 255), NOW_NS + 1050 * MS) == DARK
    assert guard.free_ns == NOW_NS + 1100 * MS


def test_lamp_shows_its_set_colour_except_while_people_localize() -> None:
    shining = lights(lamps="ab")
    shining.lamps.set_color("a", (255, 136, 0))
    assert shining.lamps.colors(NOW_NS) == {"a": (255, 136, 0), "b": DARK}
    shining.on_cursor("anna", cursor(a=0.0, b=0.0), NOW_NS)
    later_ns = NOW_NS + NS_PER_S
    assert shining.lamps.colors(later_ns)["a"] == (255, 136, 0)
    shining.lamps.queue.on_localization("anna", localization("b", "ab"), later_ns)
    assert shining.lamps.colors(later_ns + NS_PER_S)["a"] == DARK
    assert shining.lamps.colors(later_ns + NS_PER_S)["b"] == TARGET
    shining.lamps.queue.on_localization("anna", ENDED, later_ns + NS_PER_S)
    assert shining.lamps.colors(later_ns + 2 * NS_PER_S)["a"] == (255, 136, 0)
    shining.lamps.set_color("a", None)
    assert shining.lamps.colors(later_ns + 3 * NS_PER_S)["a"] == DARK


def test_lamp_outside_the_map_cannot_be_set() -> None:
    shining = lights(lamps="ab")
    with pytest.raises(ValueError, match="there is no lamp 'z'; there are a, b"):
        shining.lamps.set_color("z", (1, 2, 3))
    shining.lamps.set_color("b", (1, 2, 3))
    shining.on_map(room("a"))
    shining.on_map(room("ab"))
    assert shining.lamps.colors(NOW_NS + NS_PER_S)["b"] == DARK


S = NS_PER_S
LEFT = ("led_0", "led_1")
RIGHT = ("led_1", "led_2")
BOTH = ("led_0", "led_1", "led_2")


def news(
    since_ns: int, lamps: tuple[str, ...] = LEFT, *, phase: str = "sampling", ahead: tuple[str, ...] = ()
) -> Localization:
    points = phase == "sampling" and not ahead and bool(lamps)
    return Localization.model_validate(
        {
            "stamp_ns": 1,
            "phase": phase,
            "target_id": lamps[0] if points else "",
            "since_ns": since_ns,
            "ahead": ahead,
            "lamps": lamps,
        }
    )


def order(queue: LampQueue) -> dict[str, tuple[str, ...]]:
    return {lease.user: lease.ahead for lease in queue.service().leases}


def test_lamps_serve_the_earliest_request_and_others_wait_in_order() -> None:
    queue = LampQueue(60 * S)
    for user, since_ns in (("zoe", 20), ("ben", 10), ("anna", 20)):
        queue.on_localization(user, news(since_ns), S)
    assert order(queue) == {"ben": (), "anna": ("ben",), "zoe": ("ben", "anna")}
    assert queue.service().targets == {"led_0"}
    queue.on_localization("ben", news(10, phase="solved"), S)
    for user in ("anna", "zoe"):  # have not heard yet that ben has ended
        queue.on_localization(user, news(20, ahead=("ben",)), S)
    assert order(queue) == {"anna": (), "zoe": ("anna",)}
    assert queue.service().targets == set()
    queue.on_localization("anna", news(20), S)
    assert queue.service().targets == {"led_0"}


SILENCE_S = 60
"""Silence after which a localization without lamps has ended, s."""
LAMPS_SILENCE_S = 3
"""The same of one with lamps."""

news_of_people = st.builds(
    news,
    st.sampled_from([5, 10, 20]),
    st.sampled_from([(), LEFT, RIGHT, BOTH, ("led_2",)]),
    phase=st.sampled_from(["sampling", "sampling", "sampling", "solved"]),
    ahead=st.sampled_from([(), (), ("somebody",)]),
)
events = st.lists(
    st.tuples(
        st.sampled_from([0.0, 0.5, 1.0, 2.9, 3.0, 3.1, 56.0, 60.0, -1.0]),
        st.sampled_from(["anna", "ben", "zoe"]),
        news_of_people | st.none(),
    ),
    max_size=40,
)
"""Pauses, s, people, and what their localizers say, or None if they leave."""


@settings(max_examples=200)
@given(events)
@example([(1.0, "anna", news(20)), (0.0, "ben", news(5, ahead=("anna",)))])  # its clock is behind
@example([(1.0, "anna", news(7, ()).model_copy(update={"target_id": "led_0"}))])  # an older version lights it
def test_any_localizations_share_lamps_by_time_of_request(
    stream: list[tuple[float, str, Localization | None]],
) -> None:
    queue = LampQueue(SILENCE_S * S)
    active: dict[str, tuple[float, Localization]] = {}
    now_s = 1000.0
    for pause_s, user, localization in stream:
        now_s += pause_s
        now_ns = round(now_s * S)
        queue.expire(now_ns)
        ends_s = {
            each: at_s + (LAMPS_SILENCE_S if said.lamps else SILENCE_S)
            for each, (at_s, said) in active.items()
        }
        active = {each: row for each, row in active.items() if row[0] <= now_s < ends_s[each]}
        if localization is None:
            queue.leave(user)
            active.pop(user, None)
        else:
            queue.on_localization(user, localization, now_ns)
            active.pop(user, None)
            if localization.phase == "sampling":
                active[user] = (now_s, localization)

        # those who point come first, then by the time of the request, then by name
        rows = [(bool(said.ahead), said.since_ns, each) for each, (_, said) in active.items() if said.lamps]
        expected: dict[str, tuple[str, ...]] = {}
        targets: set[str] = set()
        for _, _, each in sorted(rows):
            said = active[each][1]
            expected[each] = tuple(other for other in expected if {*active[other][1].lamps} & {*said.lamps})
            if not expected[each] and not said.ahead:
                targets.add(said.target_id)
        assert order(queue) == expected
        assert [*order(queue)] == [*expected]
        assert queue.service().targets == targets
        assert queue.is_in_use == any(not said.ahead for _, said in active.values())
        expiry_s = [at_s + (LAMPS_SILENCE_S if said.lamps else SILENCE_S) for at_s, said in active.values()]
        assert queue.active.next_expiry_ns() == min((round(each * S) for each in expiry_s), default=None)


def test_leases_of_a_large_room_can_be_read() -> None:
    queue = LampQueue(60 * S)
    lamps = tuple(f"lamp_{index:04}" for index in range(500))
    for index in range(MAX_PEOPLE):
        queue.on_localization(f"person_{index:02}", news(index, lamps), S)
    leases = LampLeases(stamp_ns=1, leases=queue.service().leases)
    assert decode(LampLeases, encode(leases)) == leases


def test_people_without_number_are_not_all_remembered() -> None:
    queue = LampQueue(60 * S)
    for number in range(2 * MAX_PEOPLE):
        queue.on_localization("anna", news(7), S)
        queue.on_localization(f"u{number}", news(number + 8), S)
    assert len(order(queue)) == MAX_PEOPLE
    assert "anna" in order(queue)
