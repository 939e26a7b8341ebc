"""Lamps: the angle of the ray, the state of the site, hands off while localizing, few flashes."""

import math
from typing import Any, Literal

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from pointit.geometry.colormap import colormap
from pointit.schemas import NS_PER_S, Cursor, Environment, Feedback, Lamp, LampMiss, Localization
from pointit.services.led_driver.config import LampsConfig, LedDriverConfig, StateLampConfig
from pointit.services.led_driver.light_state import LightState
from pointit.services.led_driver.picture.flash_guard import FlashGuard
from tests.unit.led_driver.stage import NOW_NS, Color

VIRIDIS = colormap("viridis")
IDLE, POINTING = (40, 40, 40), (0, 120, 60)
MS = NS_PER_S // 1000


def lights(state_lamp: str = "", **state: Any) -> LightState:
    return LightState(
        LedDriverConfig(
            lamps=LampsConfig(range_deg=30.0), state_lamp=state_lamp, state=StateLampConfig(**state)
        )
    )


def cursor(**misses_deg: float) -> Cursor:
    lamps = tuple(LampMiss(id=name, miss_rad=math.radians(miss)) for name, miss in misses_deg.items())
    return Cursor(stamp_ns=NOW_NS, lamps=lamps)


def localization(phase: Literal["sampling", "solved", "cancelled"] = "sampling", **more: Any) -> Localization:
    return Localization(stamp_ns=NOW_NS, phase=phase, **more)


def cue(color: Color | None) -> Feedback:
    return Feedback(stamp_ns=NOW_NS, cue="selected", color=color)


def test_lamps_are_coloured_by_the_angle_to_the_ray() -> None:
    shining = lights()
    assert not shining.has_lamps
    shining.on_cursor("anna", cursor(a=0.0, b=15.0, c=99.0), NOW_NS)
    assert shining.has_lamps
    assert shining.lamp_colors(NOW_NS) == {
        "a": VIRIDIS.rgb(1.0), "b": VIRIDIS.rgb(0.5), "c": VIRIDIS.rgb(0.0)
    }  # fmt: skip


def test_of_several_people_the_nearest_ray_counts_and_lamps_no_longer_near_are_far() -> None:
    shining = lights()
    shining.on_cursor("anna", cursor(a=15.0, b=0.0), NOW_NS)
    shining.on_cursor("ben", cursor(a=0.0), NOW_NS)
    assert shining.lamp_colors(NOW_NS) == {"a": VIRIDIS.rgb(1.0), "b": VIRIDIS.rgb(1.0)}
    shining.on_cursor("anna", cursor(), NOW_NS)
    assert shining.lamp_colors(NOW_NS)["b"] == VIRIDIS.rgb(0.0)


def test_lamps_are_dark_when_nobody_points_any_more_and_say_when() -> None:
    shining = lights()
    shining.on_cursor("anna", cursor(a=0.0), NOW_NS)
    shining.lamp_colors(NOW_NS)
    end_ns = shining.next_lamp_change_ns(NOW_NS)
    assert end_ns == NOW_NS + 500 * MS
    assert shining.lamp_colors(end_ns) == {"a": (0, 0, 0)}
    assert shining.next_lamp_change_ns(end_ns) is None


def test_a_new_map_leaves_no_lamp_lit() -> None:
    shining = lights()
    shining.on_cursor("anna", cursor(a=0.0, b=0.0), NOW_NS)
    assert shining.lamp_colors(NOW_NS) == {"a": VIRIDIS.rgb(1.0), "b": VIRIDIS.rgb(1.0)}
    shining.on_map(Environment(stamp_ns=0, name="new", lamps=(Lamp(id="b", position_m=(0.0, 0.0, 1.0)),)))
    assert shining.lamp_colors(NOW_NS) == {"a": (0, 0, 0), "b": VIRIDIS.rgb(1.0)}
    end_ns = shining.next_lamp_change_ns(NOW_NS)
    assert end_ns is not None
    assert shining.lamp_colors(end_ns) == {"a": (0, 0, 0), "b": (0, 0, 0)}
    shining.on_cursor("anna", cursor(a=0.0), end_ns)
    assert shining.lamp_colors(end_ns)["a"] == VIRIDIS.rgb(1.0)  # it is there after all


def test_while_anybody_localizes_every_lamp_is_left_alone() -> None:
    shining = lights()
    shining.on_cursor("anna", cursor(a=0.0), NOW_NS)
    shining.on_localization("ben", localization(ahead=("cleo",)))  # waits for the lamps
    assert set(shining.lamp_colors(NOW_NS)) == {"a"}
    shining.on_localization("ben", localization(target_id="a"))
    assert shining.lamp_colors(NOW_NS) == {}
    shining.on_localization("cleo", localization(target_id="b"))
    shining.on_localization("ben", localization("solved"))
    assert shining.lamp_colors(NOW_NS) == {}
    shining.on_localization("cleo", localization("cancelled"))
    assert shining.lamp_colors(NOW_NS + 100 * MS) == {}  # the localizer's last word may still come
    assert shining.next_lamp_change_ns(NOW_NS + 100 * MS) == NOW_NS + 200 * MS
    assert shining.lamp_colors(NOW_NS + 200 * MS) == {"a": VIRIDIS.rgb(1.0)}


def test_who_crashed_while_localizing_does_not_keep_the_lamps_for_ever() -> None:
    shining = lights()
    shining.on_cursor("anna", cursor(a=0.0), NOW_NS)
    shining.on_localization("ben", localization(target_id="a"))
    assert shining.lamp_colors(NOW_NS) == {}
    later_ns = NOW_NS + 60 * NS_PER_S
    assert shining.lamp_colors(later_ns - MS) == {}
    shining.lamp_colors(later_ns)
    shining.on_cursor("anna", cursor(a=0.0), later_ns + NS_PER_S)
    assert shining.lamp_colors(later_ns + NS_PER_S) == {"a": VIRIDIS.rgb(1.0)}


def test_the_state_lamp_tells_idle_pointing_and_localizing() -> None:
    shining = lights("state")
    assert shining.lamp_colors(NOW_NS) == {"state": IDLE}
    shining.on_cursor("anna", cursor(), NOW_NS)
    assert shining.lamp_colors(NOW_NS) == {"state": POINTING}
    shining.on_localization("ben", localization(target_id="a"))
    blues = [shining.lamp_colors(NOW_NS + k * 50 * MS)["state"][2] for k in range(40)]
    rises = [k for k in range(1, 39) if blues[k - 1] < blues[k] >= blues[k + 1]]
    assert len(rises) == 2  # in two seconds
    assert max(blues) == 255
    assert min(blues) > 0
    shining.on_localization("ben", localization(target_id="state"))
    assert shining.lamp_colors(NOW_NS) == {}


def test_cues_flash_one_after_the_other() -> None:
    shining = lights("state", flash_s=0.4)
    shining.lamp_colors(NOW_NS)
    shining.on_feedback(cue((0, 255, 0)))
    shining.on_feedback(cue(None))
    assert shining.lamp_colors(NOW_NS) == {"state": (0, 255, 0)}
    shining.on_feedback(cue((255, 0, 0)))
    assert shining.lamp_colors(NOW_NS + 399 * MS) == {"state": (0, 255, 0)}
    assert shining.next_lamp_change_ns(NOW_NS + 399 * MS) == NOW_NS + 400 * MS
    assert shining.lamp_colors(NOW_NS + 400 * MS) == {"state": IDLE}
    assert shining.next_lamp_change_ns(NOW_NS + 400 * MS) == NOW_NS + 800 * MS
    assert shining.lamp_colors(NOW_NS + 800 * MS) == {"state": (255, 0, 0)}
    assert shining.lamp_colors(NOW_NS + 1200 * MS) == {"state": IDLE}
    assert shining.next_lamp_change_ns(NOW_NS + 1200 * MS) is None


def test_pulses_faster_than_twice_a_second_and_unknown_colormaps_are_refused() -> None:
    with pytest.raises(ValidationError):
        StateLampConfig(pulse_hz=2.5)
    with pytest.raises(ValidationError, match="there is no colormap 'rainbow'"):
        LampsConfig(colormap="rainbow")


def flashes_in_a_second(shown: list[tuple[int, float]]) -> int:
    """Return the most pairs of opposing changes by a tenth or more within any second."""
    turns_ns: list[int] = []
    extreme, rising = 0.0, False
    for at_ns, value in shown:
        if rising == (value > extreme):
            extreme = value
        elif abs(value - extreme) >= 0.1:
            turns_ns.append(at_ns)
            extreme, rising = value, not rising
    most = max((sum(start <= at < start + NS_PER_S for at in turns_ns) for start in turns_ns), default=0)
    return most // 2


def signals(color: Color) -> list[float]:
    red, green, blue = (value / 255 for value in color)
    return [red, green, blue, 0.2126 * red + 0.7152 * green + 0.0722 * blue]


bytes_ = st.integers(0, 255)
wild = st.lists(st.tuples(st.integers(1, 300), st.tuples(bytes_, bytes_, bytes_)), min_size=5, max_size=120)


@example([(20, (255, 255, 255) if number % 2 else (0, 0, 0)) for number in range(120)])
@given(wild)
def test_no_lamp_flashes_more_than_three_times_a_second(changes: list[tuple[int, Color]]) -> None:
    guard, now_ns = FlashGuard(), NOW_NS
    shown: list[tuple[int, Color]] = []
    for wait_ms, color in changes:
        now_ns += wait_ms * MS
        shown.append((now_ns, guard.show(color, now_ns)))
    for signal in range(4):
        assert flashes_in_a_second([(at_ns, signals(color)[signal]) for at_ns, color in shown]) <= 3
    # what was held back is shown a second later at the latest
    assert guard.show(changes[-1][1], now_ns + NS_PER_S) == changes[-1][1]


actions = st.lists(
    st.tuples(st.integers(0, 200), st.sampled_from(["cue", "cursor", "lost", "start", "stop"])), max_size=60
)


@settings(max_examples=40)
@given(actions, st.floats(0.2, 2.0), st.floats(0.1, 1.0))
def test_whatever_happens_the_state_lamp_flashes_three_times_a_second_at_most(
    happenings: list[tuple[int, str]], pulse_hz: float, flash_s: float
) -> None:
    shining = lights("state", pulse_hz=pulse_hz, flash_s=flash_s)
    now_ns = NOW_NS
    shown: list[tuple[int, Color]] = []
    for wait_ms, what in happenings:
        for _ in range(wait_ms // 50 + 1):
            now_ns += 50 * MS
            shown.append((now_ns, shining.lamp_colors(now_ns)["state"]))
        match what:
            case "cue":
                shining.on_feedback(cue((255, 255, 255)))
            case "cursor":
                shining.on_cursor("anna", cursor(), now_ns)
            case "lost":
                now_ns += 600 * MS
            case "start":
                shining.on_localization("anna", localization(target_id="a"))
            case _:
                shining.on_localization("anna", localization("solved"))
    for signal in range(4):
        assert flashes_in_a_second([(at_ns, signals(color)[signal]) for at_ns, color in shown]) <= 3
