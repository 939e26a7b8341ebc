"""The paper's two methods: by example, and against a plain reading of the paper for any sequence."""

import math
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.services.selector.dwell import Dwell, Method

STEP_NS = 100_000_000
WINDOW = 8
RELEASE = 5

hovered = st.sampled_from(["a", "b", None])
steps = st.lists(hovered, max_size=60)
HOLD: Method = "hold"
FRACTION: Method = "fraction"
methods = st.one_of(
    st.just((HOLD, 1.0)), st.tuples(st.just(FRACTION), st.sampled_from([0.25, 0.5, 0.8, 1.0]))
)


def feed(dwell: Dwell, objects: Sequence[str | None], start: int = 0) -> list[tuple[int, str]]:
    """Put one cursor in every timestep, and one more to end the last; return (ended timestep, toggled)."""
    toggles: list[tuple[int, str]] = []
    for index, object_id in enumerate([*objects, None]):
        toggled = dwell.step((start + index) * STEP_NS, object_id)
        if toggled is not None:
            toggles.append((start + index - 1, toggled))
    return toggles


def as_the_paper_says(objects: list[str | None], share: float) -> list[tuple[int, str]]:
    """Toggle what covers `share` of the last full window of timesteps, counted since the last toggle.

    A toggled object counts again from the first timestep that follows `RELEASE` timesteps off it.
    """
    toggles: list[tuple[int, str]] = []
    counted: list[str | None] = []
    last_on: dict[str, int] = {}
    for index, object_id in enumerate(objects):
        for latched in [o for o, last in last_on.items() if index - last > RELEASE]:
            del last_on[latched]
        if object_id in last_on:
            last_on[object_id] = index
            counted.append(None)
        else:
            for latched in [o for o, last in last_on.items() if index - last >= RELEASE]:
                del last_on[latched]
            counted.append(object_id)
        window = counted[-WINDOW:]
        if len(window) < WINDOW:
            continue
        full = [o for o in ("a", "b") if window.count(o) >= share * WINDOW - 1e-9]
        if not full:
            continue
        best = max(full, key=lambda o: (window.count(o), max(i for i, w in enumerate(window) if w == o)))
        toggles.append((index, best))
        last_on[best] = index
        counted = []
    return toggles


@given(methods, steps)
def test_any_sequence_toggles_as_the_paper_says(
    method: tuple[Method, float], objects: list[str | None]
) -> None:
    dwell = Dwell(method[0], fraction=method[1])
    assert feed(dwell, objects) == as_the_paper_says(objects, method[1])


@given(methods, steps)
def test_no_object_toggles_twice_without_being_left(
    method: tuple[Method, float], objects: list[str | None]
) -> None:
    last: dict[str, int] = {}
    for index, object_id in feed(Dwell(method[0], fraction=method[1]), objects):
        if object_id in last:
            between = "".join(
                "x" if o == object_id else "." for o in objects[last[object_id] + 1 : index + 1]
            )
            assert "." * RELEASE in between
        last[object_id] = index


@given(st.lists(st.integers(1, WINDOW - 1), min_size=1, max_size=20))
def test_hold_never_fires_with_a_flicker_in_every_window(streaks: list[int]) -> None:
    objects: list[str | None] = []
    for streak in streaks:
        objects += ["a"] * streak + [None]
    assert feed(Dwell("hold"), objects) == []


def test_hold_fires_when_the_window_is_full() -> None:
    assert feed(Dwell("hold"), ["a"] * 8) == [(7, "a")]
    assert feed(Dwell("hold"), ["a"] * 7) == []


def test_hold_counts_the_new_object_from_the_change() -> None:
    assert feed(Dwell("hold"), ["a"] * 4 + ["b"] * 8) == [(11, "b")]


@pytest.mark.parametrize(("on", "fires"), [(7, True), (6, False)])
def test_fraction_asks_for_its_share_of_the_window(on: int, *, fires: bool) -> None:
    objects: list[str | None] = ["a"] * 3 + [None] * (8 - on) + ["a"] * (on - 3)
    assert feed(Dwell("fraction", fraction=0.8), objects) == ([(7, "a")] if fires else [])


def test_fraction_waits_for_the_whole_window() -> None:
    # the ROS toolkit fires after four of five timesteps, before the window has passed
    dwell = Dwell("fraction", window_s=0.5, fraction=0.8)
    assert feed(dwell, ["a"] * 4) == []
    assert feed(Dwell("fraction", window_s=0.5, fraction=0.8), ["a"] * 5) == [(4, "a")]


def test_staying_toggles_once_and_coming_back_toggles_again() -> None:
    dwell = Dwell("hold")
    assert feed(dwell, ["a"] * 40) == [(7, "a")]
    assert feed(dwell, [*[None] * 3, *["a"] * 20], start=41) == []  # left for 0.4 s only
    assert feed(dwell, [*[None] * 4, *["a"] * 8], start=66) == [(77, "a")]  # and now for 0.5 s


def test_a_short_dip_of_a_finished_fraction_does_not_toggle_back() -> None:
    assert feed(Dwell("fraction"), ["a"] * 20 + [None] * 2 + ["a"] * 20) == [(7, "a")]


@pytest.mark.parametrize(("first", "last", "fires"), [(None, "a", True), ("a", None, False)])
def test_the_last_object_of_a_timestep_is_the_timesteps(
    first: str | None, last: str | None, *, fires: bool
) -> None:
    dwell = Dwell("hold")
    toggled: list[str | None] = []
    for step in range(9):
        toggled.append(dwell.step(step * STEP_NS, first))
        toggled.append(dwell.step(step * STEP_NS + STEP_NS // 2, last))
    assert toggled == [None] * 16 + (["a", None] if fires else [None, None])


def test_a_timestep_without_cursor_is_one_with_nothing_hovered() -> None:
    dwell = Dwell("hold")
    toggled = {step: dwell.step(step * STEP_NS, "a") for step in range(14) if step != 4}
    assert {step for step, object_id in toggled.items() if object_id} == {13}  # 5 to 12 are the first window


def test_after_a_long_silence_nothing_old_fires() -> None:
    dwell = Dwell("hold")
    for step in range(8):
        assert dwell.step(step * STEP_NS, "a") is None
    assert dwell.step(100 * STEP_NS, "a") is None  # 7 was never ended in time
    assert dwell.progress("a") == 0.0


def test_late_cursors_are_left_out_and_a_clock_set_back_starts_anew() -> None:
    dwell = Dwell("hold")
    for step in range(100, 106):
        dwell.step(step * STEP_NS, "a")
    assert dwell.step(104 * STEP_NS, "b") is None
    assert dwell.step(106 * STEP_NS, "a") is None
    assert dwell.progress("a") == 6 / 8
    assert dwell.step(3 * STEP_NS, "a") is None
    assert dwell.progress("a") == 0.0
    assert feed(dwell, ["a"] * 8, start=4)[0] == (10, "a")


@given(methods, steps)
def test_progress_grows_to_the_toggle_and_stays_a_share(
    method: tuple[Method, float], objects: list[str | None]
) -> None:
    dwell = Dwell(method[0], fraction=method[1])
    for index, object_id in enumerate(objects):
        before = dwell.progress(object_id)
        toggled = dwell.step(index * STEP_NS, object_id)
        assert 0.0 <= dwell.progress(object_id) < 1.0
        if toggled is not None:
            assert dwell.progress(toggled) == 0.0
        elif index and objects[index - 1] == object_id and method[0] == "hold":
            assert dwell.progress(object_id) in (0.0, before + 1 / WINDOW)


@given(st.floats(0.01, 1.0), st.floats(0.05, 3.0))
def test_the_share_is_never_more_than_asked(fraction: float, window_s: float) -> None:
    dwell = Dwell("fraction", fraction=fraction, window_s=window_s, timestep_s=0.05)
    assert dwell.needed == max(1, math.ceil(fraction * dwell.window - 1e-9)) <= dwell.window
