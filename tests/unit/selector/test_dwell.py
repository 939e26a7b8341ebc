"""The paper's two methods: by example, and against a plain reading of the paper for any sequence."""

from collections.abc import Sequence
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointit.services.selector.methods.dwell import Dwell, Method

MS = 1_000_000
STEP_NS = 100 * MS
WINDOW = 8
RELEASE = 5

hovered = st.sampled_from(["a", "b", None])
steps = st.lists(hovered, max_size=60) | st.lists(st.tuples(hovered, st.integers(1, 12)), max_size=12).map(
    lambda stays: [object_id for object_id, count in stays for _ in range(count)]
)
"""Objects of timesteps. Stays of the second kind are long enough that windows are full."""
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


@settings(max_examples=150)
@given(methods, steps)
def test_any_sequence_toggles_as_the_paper_says(
    method: tuple[Method, float], objects: list[str | None]
) -> None:
    dwell = Dwell(method[0], fraction=method[1])
    assert feed(dwell, objects) == as_the_paper_says(objects, method[1])


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


def put(dwell: Dwell, cursors: Sequence[tuple[int, str | None]]) -> list[tuple[int, str]]:
    """Put (time in ms, object) cursors; return (time of the cursor that toggled, toggled)."""
    toggles = [(time_ms, dwell.step(time_ms * MS, object_id)) for time_ms, object_id in cursors]
    return [(time_ms, object_id) for time_ms, object_id in toggles if object_id is not None]


def jittered_ms(rate_hz: int, jitter_ms: int, seed: int, duration_ms: int = 10_000) -> list[int]:
    """Return times of cursors at `rate_hz`, each off by at most `jitter_ms`."""
    random = Random(seed)
    period_ms = 1000 / rate_hz
    count = int(duration_ms / period_ms)
    return [round((1 + k) * period_ms) + random.randint(-jitter_ms, jitter_ms) for k in range(count)]


slow_wrists = st.sampled_from([(5, 25), (8, 60), (10, 45), (10, 0)]).flatmap(
    lambda wrist: st.builds(jittered_ms, st.just(wrist[0]), st.just(wrist[1]), st.integers(0, 10_000))
)


@given(st.sampled_from([HOLD, FRACTION]), slow_wrists, st.sampled_from([0.1, 0.5]))
def test_a_slow_wrist_with_jitter_toggles_after_the_window(
    method: Method, times_ms: list[int], release_s: float
) -> None:
    toggles = put(Dwell(method, release_s=release_s), [(time_ms, "a") for time_ms in times_ms])
    assert [object_id for _, object_id in toggles] == ["a"]
    # the window's eight timesteps, and the rest of the last one and the gap to the cursor after it
    assert 700 <= toggles[0][0] - times_ms[0] <= 800 + 100 + 250


def test_a_silence_within_the_longest_gap_is_held_and_a_longer_one_restarts() -> None:
    def silent_from_400(silence_ms: int) -> list[tuple[int, str]]:
        times_ms = [*range(0, 401, 10), *range(400 + silence_ms, 3000, 10)]
        return put(Dwell("hold", longest_gap_s=0.25), [(time_ms, "a") for time_ms in times_ms])

    assert silent_from_400(200) == [(800, "a")]
    assert silent_from_400(400) == [(1600, "a")]  # nothing was hovered in the timesteps from 600 to 800
    assert put(Dwell("hold", longest_gap_s=0.05), [(t, "a") for t in range(0, 3000, 200)]) == []


@pytest.mark.parametrize(("last_ms", "next_ms", "toggled_ms"), [(450, 700, 800), (449, 700, 1500)])
def test_hold_goes_on_while_the_cursor_is_at_most_the_longest_gap_old(
    last_ms: int, next_ms: int, toggled_ms: int
) -> None:
    # the timestep from 600 has no cursor of its own: at its end that of 450 is exactly 250 ms old
    times_ms = [*range(0, last_ms, 10), last_ms, next_ms, *range(800, 3000, 10)]
    assert put(Dwell("hold"), [(time_ms, "a") for time_ms in times_ms]) == [(toggled_ms, "a")]


@pytest.mark.parametrize("silence_ms", [310, 490])
def test_a_silence_shorter_than_the_release_neither_empties_a_fraction_nor_unlatches(silence_ms: int) -> None:
    times_ms = [*range(0, 401, 10), *range(400 + silence_ms, 3000, 10)]
    dwell = Dwell("fraction", fraction=0.6)
    assert put(dwell, [(time_ms, "a") for time_ms in times_ms]) == [(max(800, 400 + silence_ms), "a")]
    later_ms = range(3000 + silence_ms - 10, 6000, 10)
    assert put(dwell, [(time_ms, "a") for time_ms in later_ms]) == []
    assert list(dwell.latched) == ["a"]


def test_an_object_left_during_a_silence_is_not_held() -> None:
    cursors: list[tuple[int, str | None]] = [(time_ms, "a") for time_ms in range(0, 700, 10)]
    assert put(Dwell("hold"), [*cursors, (710, None), (890, None), (1000, "a"), (1190, "a")]) == []


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
