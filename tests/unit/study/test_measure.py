"""Measures, and their markers in LSL."""

import asyncio
import importlib
import json
import math
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest

import pointit
from pointit.forearm.true_pose import TruePose
from pointit.runtime.errors import ConfigError
from pointit.schemas import (
    Announced,
    ButtonEvent,
    Cursor,
    Hover,
    Localization,
    RobotState,
    SelectionEvent,
    Step,
)
from pointit.study import session
from pointit.study.lsl import LslOutlets
from pointit.study.measure import Attempt
from pointit.study.simulated import SimulatedView, person_of
from pointit.study.study_site import SiteOptions
from tests.unit.study.studies import SMALL, read_rows, small

S = 1_000_000_000


def attempt(end: str = "selection", **fields: object) -> Attempt:
    usual = {"began_ns": 0, "target": "t", "target_m": (4.0, 0.0, 1.0), "width_m": 0.4, "timeout_s": 5.0}
    return Attempt(**{**usual, "end": end, **fields})  # pyrefly: ignore[bad-argument-type]


def cursor(azimuth_deg: float, now_s: float) -> Cursor:
    """Return a cursor on a wall at x = 4 m, seen from the origin 1 m high."""
    angle_rad = math.radians(azimuth_deg)
    return Cursor(
        stamp_ns=round(now_s * S),
        point_m=(4.0, 4.0 * math.tan(angle_rad), 1.0),
        origin_m=(0.0, 0.0, 1.0),
        direction=(math.cos(angle_rad), math.sin(angle_rad), 0.0),
    )


def selected(name: str) -> SelectionEvent:
    return SelectionEvent(stamp_ns=0, event="selected", object_id=name, user="P01")


def test_measures_of_a_selection_are_those_computed_by_hand() -> None:
    one = attempt()
    for azimuth_deg, now_s in ((30.0, 0.1), (30.2, 0.2), (10.0, 0.3), (-5.0, 0.4), (2.0, 0.5)):
        one.on_cursor(cursor(azimuth_deg, now_s), round(now_s * S))
        one.on_hover(Hover(stamp_ns=0, object_id="t" if abs(azimuth_deg) < 6 else ""), round(now_s * S))
    one.on_hover(Hover(stamp_ns=0, object_id="other"), round(0.6 * S))
    one.on_hover(Hover(stamp_ns=0, object_id="t"), round(0.7 * S))

    one.tick(round(0.8 * S))
    assert one.outcome is None
    one.on_selection(selected("t"), round(1.25 * S))
    measures = one.columns()
    assert one.outcome == "hit"
    assert (measures["first_hover_s"], measures["selection_s"], measures["corrections"]) == (0.4, 1.25, 1)
    assert measures["path_length_deg"] == pytest.approx(20.0 + 15.0 + 7.0)
    assert measures["error_deg"] == pytest.approx(2.0)
    assert measures["error_m"] == pytest.approx(4.0 * math.tan(math.radians(2.0)))
    assert measures["target_distance_deg"] == pytest.approx(30.0)
    assert measures["target_distance_m"] == pytest.approx(4.0 * math.tan(math.radians(30.0)))
    assert measures["target_width_deg"] == pytest.approx(2.0 * math.degrees(math.atan(0.05)))
    assert attempt(before_m=(4.0, -1.0, 1.0)).columns()["target_distance_m"] == 1.0


def named(name: str) -> Announced:
    return Announced(stamp_ns=1, object_id=name, label=name)


STEP = Step(stamp_ns=1, by=1)
PRESSED = selected("t").model_copy(update={"cause": "button"})
NAMES: dict[str, tuple[list[Announced | Step | SelectionEvent], list[int | None]]] = {
    "all are counted until the end": (
        [named("other"), named(""), named("t"), STEP, STEP, PRESSED, named("t"), STEP], [2, 2, 1]),
    "a step before the first name counts": ([named(""), STEP, named("t")], [1, 1, 0]),
    "a selection by staying is not confirmed": ([named(""), selected("t")], [0, 0, 0]),
    "nothing is known where names are not spoken": ([STEP, PRESSED], [None] * 3),
}  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_names_steps_and_presses_are_counted_where_names_are_spoken(name: str) -> None:
    one = attempt("press")
    happens, counts = NAMES[name]
    for number, message in enumerate(happens, 1):
        match message:
            case Announced():
                one.on_announced(message, number * S)
            case Step():
                one.on_step(message, number * S)
            case _:
                one.on_selection(message, number * S)
    measures = one.columns()
    assert [measures[name] for name in ("announced", "stepped", "confirmed")] == counts


def test_ray_point_nearest_the_target_is_selected_without_a_surface() -> None:
    one = attempt()
    one.on_cursor(cursor(10.0, 0.1).model_copy(update={"point_m": None}), round(0.1 * S))
    measures = one.columns()
    angle_rad = math.radians(10.0)
    assert measures["error_m"] == pytest.approx(4.0 * math.sin(angle_rad))
    assert measures["selected_x_m"] == pytest.approx(4.0 * math.cos(angle_rad) ** 2)
    assert measures["selected_y_m"] == pytest.approx(4.0 * math.cos(angle_rad) * math.sin(angle_rad))


@pytest.mark.parametrize(
    ("end", "hovered", "happens", "outcome", "reason"),
    [
        ("selection", "t", selected("other"), "wrong", "selected other"),
        (
            "selection",
            "t",
            SelectionEvent(stamp_ns=0, event="left", object_id="t"),
            "timeout",
            "the target has left",
        ),
        ("selection", "t", None, "timeout", ""),
        ("timeout", "t", selected("other"), "hit", ""),
        ("timeout", "", None, "timeout", ""),
        ("press", "", ButtonEvent(stamp_ns=0), "wrong", "pressed beside"),
        ("press", "t", selected("t"), "hit", ""),
    ],
)
def test_attempt_ends_as_the_study_says(
    end: str, hovered: str, happens: SelectionEvent | ButtonEvent | None, outcome: str, reason: str
) -> None:
    one = attempt(end)
    one.on_hover(Hover(stamp_ns=0, object_id=hovered), S // 10)
    if isinstance(happens, SelectionEvent):
        one.on_selection(happens, S)
    elif happens is not None:
        one.on_press(happens, S)
    for tenths in range(60):
        one.on_cursor(cursor(0.0, tenths / 10), tenths * S // 10)
        one.tick(tenths * S // 10)
    assert (one.outcome, one.reason) == (outcome, reason)


def robot(x_m: float, phase: str = "moving") -> RobotState:
    state = {"kind": "quadrotor", "phase": phase, "position_m": (x_m, 0.0, 0.2), "yaw_rad": 0.0}
    return RobotState.model_validate(
        {**state, "stamp_ns": 0, "velocity_mps": (0.0, 0.0, 0.0), "radius_m": 0.1}
    )


@pytest.mark.parametrize(("x_m", "outcome", "reason"), [(4.1, "hit", ""), (4.3, "wrong", "landed beside")])
def test_landing_of_a_robot_that_has_flown_ends_an_attempt(x_m: float, outcome: str, reason: str) -> None:
    one = attempt()
    for now_s, state in enumerate(
        (robot(4.0, "landed"), robot(4.0), robot(3.0), robot(x_m), robot(x_m, "landed"))
    ):
        assert one.outcome is None
        one.on_robot(state, now_s * S)
    measures = one.columns()
    assert (one.outcome, one.reason, measures["selection_s"]) == (outcome, reason, 4.0)
    assert (measures["first_hover_s"], measures["corrections"]) == (0.0, 1)
    assert measures["error_m"] == pytest.approx(abs(x_m - 4.0))


def test_robot_that_has_stayed_over_the_target_ends_an_attempt() -> None:
    one = attempt(stay_s=1.0)
    for tenths, x_m in enumerate([3.0] * 5 + [4.0] * 5 + [3.0] * 5 + [4.0] * 20):
        one.on_robot(robot(x_m), tenths * S // 10)
    assert (one.outcome, one.first_hover_s, one.selection_s, one.corrections) == ("hit", 0.5, 2.5, 1)


@pytest.mark.parametrize(
    ("phase", "since_s", "found_m", "outcome", "reason"),
    [
        ("solved", 1, (4.1, 0.1, 0.0), "hit", ""),
        ("solved", 1, (4.1, 0.3, 0.0), "wrong", "too far off"),
        ("solved", -1, (4.0, 0.0, 0.0), None, ""),  # an earlier one
        ("refused", 1, None, "wrong", "no room"),
        ("sampling", 1, (4.0, 0.0, 0.0), None, ""),
    ],
)
def test_end_of_a_localization_ends_an_attempt(
    phase: str, since_s: int, found_m: Any, outcome: str | None, reason: str
) -> None:
    one = attempt(began_ns=10 * S)
    state = {"stamp_ns": 0, "phase": phase, "since_ns": (10 + since_s) * S, "reason": "no room"}
    one.on_localization(Localization.model_validate(state), found_m, 13 * S)
    assert (one.outcome, one.reason) == (outcome, reason)


def test_attempt_does_not_count_when_the_wrist_is_lost() -> None:
    one = attempt()
    one.on_cursor(cursor(0.0, 1.0), S)
    one.tick(round(2.9 * S))
    assert one.outcome is None
    one.tick(round(3.1 * S))
    assert one.outcome == "skipped"
    assert one.reason.startswith("repeated: no ray")


def test_end_rule_in_python_ends_an_attempt() -> None:
    def ends(now: Attempt) -> str | None:
        return "hit" if now.passed_s > 1.0 else None

    one = attempt("ends.py:ends", end_rule=ends)
    one.on_cursor(cursor(0.0, 0.5), S // 2)
    assert one.outcome is None
    one.on_cursor(cursor(0.0, 1.5), 3 * S // 2)
    measures = one.columns()
    assert (measures["outcome"], measures["selection_s"]) == ("hit", 1.5)


def divides(_now: Attempt) -> float:
    return 1 / 0  # pyrefly: ignore[division-by-zero]


@pytest.mark.parametrize(("ends", "sentence"), [(repr, "returns"), (divides, "ZeroDivisionError")])
def test_end_rule_in_python_that_fails_is_said(ends: Callable[[Attempt], Any], sentence: str) -> None:
    with pytest.raises(ConfigError, match=f"(?s)end: the study's function .*{sentence}"):
        attempt("ends.py:ends", end_rule=ends).on_cursor(cursor(0.0, 0.5), S // 2)


INLET = """
import json, sys, pylsl
inlets = []
for kind in ("markers", "ray", "cursor", "selection", "truth"):
    (found,) = pylsl.resolve_byprop("source_id", f"pointit-{sys.argv[1]}-P01-{kind}", 1, 20.0)
    inlets.append(pylsl.StreamInlet(found, max_buflen=60))
    inlets[-1].open_stream(20.0)
info = inlets[1].info(20.0)
channel = info.desc().child("channels").child("channel")
print(json.dumps([info.name(), channel.child_value("label"), channel.child_value("unit")]), flush=True)
sys.stdin.readline()
for inlet in inlets:
    print(json.dumps([inlet.pull_sample(20.0), inlet.pull_sample(20.0)]), flush=True)
"""


@pytest.mark.wall_time
async def test_streams_are_readable_by_another_process_at_capture_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "lsl_api.cfg").write_text("[multicast]\nResolveScope = machine\n[log]\nlevel = -3\n")
    monkeypatch.setenv("LSLAPICFG", str(tmp_path / "lsl_api.cfg"))
    pylsl = importlib.import_module("pylsl")  # it reads the file as it is loaded

    study = f"small{os.getpid()}"  # another run of this test on this machine has others
    outlets = LslOutlets(study, "P01")
    other = await asyncio.create_subprocess_exec(
        sys.executable, "-c", INLET, study, stdin=-1, stdout=-1, env={**os.environ}
    )
    assert other.stdin is not None
    assert other.stdout is not None
    assert json.loads(await other.stdout.readline()) == ["PointIt ray", "origin_x", "m"]

    ray = {"origin_m": (1.0, 2.0, 3.0), "direction": (0.0, 1.0, 0.0), "point_m": (1.0, 5.0, 3.0)}
    cursor = Cursor.model_validate({"stamp_ns": 100 * S, **ray})
    selected = SelectionEvent(stamp_ns=99 * S, event="selected", object_id="t1-0", user="P01")
    begin_s = pylsl.local_clock()
    outlets.mark(event="trial_start", trial=1)
    outlets.mark(event="trial_end", trial=1, outcome="hit")
    outlets.send(cursor, 100 * S + S // 4)
    outlets.send(Cursor(stamp_ns=101 * S), 101 * S)
    outlets.send(selected, 102 * S)
    outlets.send(selected, 99 * S)
    outlets.send(TruePose(100 * S, (1.0, 2.0, 1.75), 0.5), 100 * S + S // 2)
    outlets.send(TruePose(101 * S, (1.0, 2.0, 1.75), None), 101 * S)
    end_s = pylsl.local_clock()
    other.stdin.write(b"\n")
    await other.stdin.drain()
    markers, rays, cursors, selections, truths = [json.loads(await other.stdout.readline()) for _ in range(5)]

    assert await other.wait() == 0

    assert [json.loads(sample[0]) for sample, _ in markers] == [
        {"event": "trial_start", "trial": 1},
        {"event": "trial_end", "trial": 1, "outcome": "hit"},
    ]
    assert rays[0][0] == [1.0, 2.0, 3.0, 0.0, 1.0, 0.0]
    assert cursors[0][0] == [1.0, 5.0, 3.0]
    assert all(math.isnan(value) for value in [*rays[1][0], *cursors[1][0]])
    assert json.loads(selections[0][0][0]) == {"event": "selected", "object_id": "t1-0", "user": "P01"}
    assert truths[0][0] == [1.0, 2.0, 1.75, 0.5]
    assert truths[1][0][:3] == [1.0, 2.0, 1.75]
    assert math.isnan(truths[1][0][3])

    ages_s = (
        *((markers, (0.0, 0.0)), (rays, (0.25, 0.0)), (cursors, (0.25, 0.0)), (selections, (3.0, 0.0))),
        (truths, (0.5, 0.0)),
    )
    for samples, ages in ages_s:
        for (_, stamp_s), age_s in zip(samples, ages, strict=True):
            assert begin_s - 1e-6 <= stamp_s + age_s <= end_s + 1e-6


INLET_OF_RAYS = """
import json, sys, pylsl
inlets = []
for kind in ("ray", "cursor"):
    (info,) = pylsl.resolve_byprop("source_id", f"pointit-{sys.argv[1]}-P02-{kind}", 1, 20.0)
    inlets.append(pylsl.StreamInlet(info, max_buflen=60))
    inlets[-1].open_stream(20.0)
print("open", flush=True)
print(json.dumps([[inlet.pull_sample(20.0)[1] for _ in range(int(sys.argv[2]))] for inlet in inlets]))
"""


@pytest.mark.wall_time
async def test_ray_and_cursor_of_a_message_share_one_monotonic_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "lsl_api.cfg").write_text("[multicast]\nResolveScope = machine\n[log]\nlevel = -3\n")
    monkeypatch.setenv("LSLAPICFG", str(tmp_path / "lsl_api.cfg"))
    pylsl = importlib.import_module("pylsl")  # it reads the file as it is loaded
    count = 40
    study = f"delayed{os.getpid()}"
    begin_s = pylsl.local_clock()
    passed_s = 0.0

    def local_clock() -> float:
        nonlocal passed_s
        passed_s += 1e-4
        return float(begin_s + passed_s)

    monkeypatch.setattr(pylsl, "local_clock", local_clock)
    outlets = LslOutlets(study, "P02")
    other = await asyncio.create_subprocess_exec(
        sys.executable, "-c", INLET_OF_RAYS, study, str(count), stdout=-1, env={**os.environ}
    )
    assert other.stdout is not None
    assert await other.stdout.readline() == b"open\n"

    for number in range(count):
        passed_s = number / 100 + (0.03 if number % 8 == 4 else 0.0)  # a busy machine, after the site's clock
        outlets.send(Cursor(stamp_ns=(number + 1) * S // 100), (number + 3) * S // 100)
    rays_s, cursors_s = json.loads(await other.stdout.readline())
    assert await other.wait() == 0
    assert len(rays_s) == count
    assert rays_s == cursors_s
    assert rays_s == sorted(rays_s)

    errors_s = [stamp_s - begin_s - number / 100 + 0.02 for number, stamp_s in enumerate(rays_s)]
    assert 0.0 < min(errors_s) < 0.001
    assert max(errors_s) < 0.031


def test_session_marks_each_attempt_and_sends_what_it_hears(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    marks: list[dict[str, Any]] = []
    heard: Counter[type[object]] = Counter()

    class Outlets:
        def __init__(self, *names: str) -> None:
            assert names == ("small", "P01")

        def mark(self, **marker: object) -> None:
            marks.append(marker)

        def send(self, message: object, now_ns: int) -> None:
            assert now_ns > 0
            heard[type(message)] += 1

    monkeypatch.setattr(session, "LslOutlets", Outlets)
    study, folder = small(tmp_path, SMALL.replace("repetitions: 2", "repetitions: 1"))
    setup = SiteOptions(person=person_of(study, "P01"), lsl=True)
    view = SimulatedView(0, lambda _status: None)
    pointit.run_virtually(session.Session(study, folder, "P01", view, setup).run())
    rows = read_rows(folder.path / "P01/trials.csv")
    starts = marks[::2]
    ends = marks[1::2]
    begun = ("trial", "attempt", "method", "practice", "target")
    ended = ("trial", "attempt", "outcome", "reason")
    assert starts == [{"event": "trial_start", **marked(row, begun)} for row in rows]
    assert ends == [{"event": "trial_end", **marked(row, ended)} for row in rows]
    assert heard[Cursor] > 100
    assert heard[SelectionEvent] >= 2


def marked(row: dict[str, str], columns: Iterable[str]) -> dict[str, object]:
    """Return values of a row as markers have them: numbers as numbers."""
    return {name: int(row[name]) if row[name].isdecimal() else row[name] for name in columns}
