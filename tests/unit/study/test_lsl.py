"""Streams of a session, read back by another process with pylsl alone."""

import asyncio
import json
import math
import os
import sys
from pathlib import Path

import pytest

from pointit.schemas import Cursor, SelectionEvent
from pointit.study.site.lsl import LslOutlets

S = 1_000_000_000
INLET = """
import json, sys, pylsl
inlets = []
for kind in ("markers", "ray", "cursor", "selection"):
    (found,) = pylsl.resolve_byprop("source_id", f"pointit-small-P01-{kind}", 1, 20.0)
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
    import pylsl  # noqa: PLC0415 - it reads the file as it is loaded

    outlets = LslOutlets("small", "P01")
    other = await asyncio.create_subprocess_exec(
        sys.executable, "-c", INLET, stdin=-1, stdout=-1, env={**os.environ}
    )
    assert other.stdin is not None
    assert other.stdout is not None
    assert json.loads(await other.stdout.readline()) == ["PointIt ray", "origin_x", "m"]
    cursor = Cursor(
        stamp_ns=100 * S, origin_m=(1.0, 2.0, 3.0), direction=(0.0, 1.0, 0.0), point_m=(1.0, 5.0, 3.0)
    )
    selected = SelectionEvent(stamp_ns=99 * S, event="selected", object_id="t1-0", user="P01")
    begin_s = pylsl.local_clock()
    outlets.mark(event="trial_start", trial=1)
    outlets.mark(event="trial_end", trial=1, outcome="hit")
    outlets.send(cursor, 100 * S + S // 4)
    outlets.send(Cursor(stamp_ns=101 * S), 101 * S)
    outlets.send(selected, 102 * S)
    outlets.send(selected, 99 * S)
    end_s = pylsl.local_clock()
    other.stdin.write(b"\n")
    await other.stdin.drain()
    markers, rays, cursors, selections = [json.loads(await other.stdout.readline()) for _ in range(4)]
    assert await other.wait() == 0

    assert [json.loads(sample[0]) for sample, _ in markers] == [
        {"event": "trial_start", "trial": 1},
        {"event": "trial_end", "trial": 1, "outcome": "hit"},
    ]
    assert rays[0][0] == [1.0, 2.0, 3.0, 0.0, 1.0, 0.0]
    assert cursors[0][0] == [1.0, 5.0, 3.0]
    assert all(math.isnan(value) for value in [*rays[1][0], *cursors[1][0]])
    assert json.loads(selections[0][0][0]) == {"event": "selected", "object_id": "t1-0", "user": "P01"}
    ages_s = ((markers, (0.0, 0.0)), (rays, (0.25, 0.0)), (cursors, (0.25, 0.0)), (selections, (3.0, 0.0)))
    for samples, ages in ages_s:
        for (_, stamp_s), age_s in zip(samples, ages, strict=True):
            assert begin_s - 1e-6 <= stamp_s + age_s <= end_s + 1e-6
