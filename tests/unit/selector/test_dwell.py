"""The paper's two methods: any cursors against a reading of the docstring, and its figures by example."""

from collections.abc import Sequence
from itertools import accumulate

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pointit.services.selector.methods.dwell import Dwell, Method

MS = 1_000_000
STEP = 100
"""Timestep, ms."""
WINDOW = 8
"""Timesteps of a window."""
GAP = 250
"""Longest gap, ms."""

Cursors = list[tuple[int, str | None]]
"""Times, ms, and the objects that are hovered."""

DwellMethod = tuple[Method, float]
"""Method, and its share of a window."""

methods = st.sampled_from([("hold", 1.0), *(("fraction", share) for share in (0.25, 0.5, 0.8, 1.0))])
releases = st.sampled_from([1, 5])
pauses_ms = st.sampled_from([1, 10, 40, 99, 100, 101, 140, 200, 249, 250, 251, 310, 490, 700, -150, -2000])
cursors = st.lists(
    st.tuples(st.lists(pauses_ms, min_size=1, max_size=12), st.sampled_from(["a", "b", None])), max_size=12
).map(lambda stays: timed([(pause, name) for pauses, name in stays for pause in pauses]))


def timed(steps: Sequence[tuple[int, str | None]], start_ms: int = 100_000) -> Cursors:
    """Return cursors with pauses before them."""
    times = accumulate((pause for pause, _ in steps), initial=start_ms)
    return list(zip(list(times)[1:], (name for _, name in steps), strict=True))


def every(period_ms: int, until_ms: int, name: str | None = "a", start_ms: int = 0) -> Cursors:
    return [(at, name) for at in range(start_ms, until_ms, period_ms)]


def toggles(dwell: Dwell, stream: Cursors) -> Cursors:
    """Return the times of the cursors that toggled, and what."""
    found = [(at, dwell.step(at * MS, name)) for at, name in stream]
    return [(at, name) for at, name in found if name is not None]


def as_the_docstring_says(stream: Cursors, share: float, release: int) -> tuple[Cursors, set[str]]:
    """Return the toggles and what is latched at the end."""
    toggled: Cursors = []
    window: list[str | None] = []
    away: dict[str, int] = {}
    in_order: Cursors = []
    for at, name in stream:
        before = in_order[-1] if in_order else (at, None)
        if at // STEP < before[0] // STEP - WINDOW:  # the clock was set back
            window = []
            away = {}
            in_order = [(at, name)]
            continue
        if at < before[0]:
            continue
        in_order.append((at, name))
        first = before[0] // STEP
        last = at // STEP
        if last - first > release and at - before[0] > GAP:
            window = [None] * WINDOW
            away = {}
            continue
        fired: str | None = None
        for step in range(first, last):
            hovered = before[1] if step == first or (step + 1) * STEP - before[0] <= GAP else None
            away = {each: 0 if each == hovered else count + 1 for each, count in away.items()}
            away = {each: count for each, count in away.items() if count < release}
            window = [*window, None if hovered in away else hovered][-WINDOW:]
            counts = {each: window.count(each) for each in reversed(window) if each}
            best = max(counts, key=counts.__getitem__, default=None)
            if len(window) == WINDOW and best and counts[best] >= share * WINDOW - 1e-9:
                window = []
                fired = best
                away[best] = 0
        if fired:
            toggled.append((at, fired))
    return toggled, set(away)


@settings(max_examples=400)
@given(methods, releases, cursors)
@example(("hold", 1.0), 5, [*every(10, 700), (710, None), (890, None), (1000, "a"), (1190, "a")])
def test_any_cursors_toggle_as_the_docstring_says(method: DwellMethod, release: int, stream: Cursors) -> None:
    dwell = Dwell(method[0], fraction=method[1], release_s=release / 10)
    found = toggles(dwell, stream)
    assert (found, set(dwell.latched)) == as_the_docstring_says(stream, method[1], release)


@pytest.mark.parametrize(
    ("stream", "toggled_ms"),
    [
        (every(10, 2000), [800]),
        (every(10, 401) + every(10, 2000, start_ms=600), [800]),  # a silence within the longest gap is held
        (every(10, 401) + every(10, 2000, start_ms=800), [1600]),  # a longer one restarts
        ([*every(10, 450), (450, "a"), (700, "a"), *every(10, 2000, start_ms=800)], [800]),
        ([*every(10, 449), (449, "a"), (700, "a"), *every(10, 2000, start_ms=800)], [1500]),
        (every(200, 4000, start_ms=100), [900]),  # a slow wrist
        (every(10, 700) + every(10, 900, None, 710) + every(10, 1200, start_ms=1000), []),
    ],
)
def test_hold_by_example(stream: Cursors, toggled_ms: list[int]) -> None:
    assert [at for at, _ in toggles(Dwell("hold"), stream)] == toggled_ms


@given(methods, st.lists(st.sampled_from(["a", "b", None]), max_size=60))
def test_progress_grows_to_the_toggle_and_stays_a_share(method: DwellMethod, names: list[str | None]) -> None:
    dwell = Dwell(method[0], fraction=method[1])
    for index, name in enumerate(names):
        before = dwell.progress(name)
        toggled = dwell.step(index * STEP * MS, name)
        assert 0.0 <= dwell.progress(name) < 1.0
        if toggled is not None:
            assert dwell.progress(toggled) == 0.0
        elif index and names[index - 1] == name and method[0] == "hold":
            assert dwell.progress(name) in (0.0, before + 1 / WINDOW)


@pytest.mark.parametrize(("away", "fires"), [(4, False), (5, True)])
def test_fraction_method_fires_again_after_half_a_second_away(away: int, *, fires: bool) -> None:
    names = ["a"] * 7 + [None] * (1 + away) + ["a"] * 12
    found = toggles(Dwell("fraction"), [(STEP * index, name) for index, name in enumerate(names)])
    assert len(found) == 1 + fires
