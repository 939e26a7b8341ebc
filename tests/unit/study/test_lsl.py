"""Streams of a session, read back by another process with pylsl alone."""

import asyncio
import importlib
import json
import math
import os
import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

import pointit
from pointit.forearm.true_pose import TruePose
from pointit.schemas import Cursor, SelectionEvent
from pointit.study import session
from pointit.study.lsl import LslOutlets
from pointit.study.simulated import SimulatedView, person_of
from pointit.study.study_site import SiteOptions
from tests.unit.study.studies import SMALL, read_rows, small

S = 1_000_000_000
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
async def test_streams_are_read_by_another_process_at_the_times_of_capture(
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
async def test_ray_and_cursor_of_one_message_have_one_time_that_never_goes_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "lsl_api.cfg").write_text("[multicast]\nResolveScope = machine\n[log]\nlevel = -3\n")
    monkeypatch.setenv("LSLAPICFG", str(tmp_path / "lsl_api.cfg"))
    pylsl = importlib.import_module("pylsl")  # it reads the file as it is loaded
    count, study, begin_s, passed_s = 40, f"delayed{os.getpid()}", pylsl.local_clock(), 0.0

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
    starts, ends = marks[::2], marks[1::2]
    begun = ("trial", "attempt", "method", "practice", "target")
    ended = ("trial", "attempt", "outcome", "reason")
    assert starts == [{"event": "trial_start", **marked(row, begun)} for row in rows]
    assert ends == [{"event": "trial_end", **marked(row, ended)} for row in rows]
    assert heard[Cursor] > 100
    assert heard[SelectionEvent] >= 2


def marked(row: dict[str, str], columns: Iterable[str]) -> dict[str, object]:
    """Return values of a row as markers have them: numbers as numbers."""
    return {name: int(row[name]) if row[name].isdecimal() else row[name] for name in columns}
