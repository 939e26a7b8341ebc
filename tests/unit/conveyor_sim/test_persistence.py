"""Stored snapshots of a conveyor, and its restoration from them."""

import contextlib
import json
import sqlite3
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.services.conveyor_sim import persistence
from pointit.services.conveyor_sim.persistence import FILE, PlantPersistence, fingerprint
from tests.unit.conveyor_sim.rooms import CHAIN, FORK, ROOMS, S, check_apart, config, plant


@given(
    st.sampled_from(sorted(ROOMS)),
    st.floats(1.0, 40.0),
    st.sampled_from([0.5, 1.0, -0.5, 0.0]),
    st.floats(0.3, 3.0),
)
def test_one_that_was_restored_is_as_the_one_before(
    name: str, until_s: float, speed_mps: float, interval_s: float
) -> None:
    feeder = {"interval_s": interval_s, "length_m": 0.3, "initial": 2}
    before = plant(ROOMS[name], feeder=feeder)
    before.step(round(until_s / 2 * S))
    before.select({t.id: "anna" for t in before.tracked(0).objects[::2]})
    before.set_speed(speed_mps, (ROOMS[name].belts[0].id,))
    now_ns = round(until_s * S)
    before.step(now_ns)
    after = plant(ROOMS[name], feeder=feeder)
    after.skip_time(now_ns)

    after.restore(json.loads(json.dumps(before.snapshot())))
    assert after.tracked(now_ns) == before.tracked(now_ns)
    assert after.state(now_ns) == before.state(now_ns)
    assert after.snapshot() == before.snapshot()

    ids = {tracked.id for tracked in before.tracked(0).objects}
    left = 0
    for _ in range(50):
        now_ns += S // 5
        left += len(after.step(now_ns))
        objects = after.tracked(now_ns).objects
        check_apart(ROOMS[name], objects)
        assert after.fed - before.fed == len(objects) + left - before.size
        assert all(tracked.id in ids or int(tracked.id.split("-")[1]) > len(ids) for tracked in objects)


def test_schedule_goes_on_where_it_was(tmp_path: Path) -> None:
    path = tmp_path / "steps.yaml"
    feeder = "{random: False, kind_sequence: [0, 1], min_interval: 2.0, max_interval: 2.0}"
    path.write_text(
        f"steps: {{1: {{speed: 0.5, duration: 5, feeders: {{a: {feeder}}}}}, "
        f"2: {{speed: 1, duration: 9, feeders: {{a: {feeder}}}}}}}"
    )
    before, after = (plant(CHAIN, schedule=str(path)) for _ in range(2))
    before.step(8 * S)
    after.skip_time(8 * S)

    after.restore(json.loads(json.dumps(before.snapshot())))
    assert after.state(0).step == before.state(0).step == "2"
    before.step(30 * S)
    after.step(30 * S)
    assert after.tracked(0) == before.tracked(0)
    assert after.state(0) == before.state(0)
    assert after.state(0).step == "end"

    again = plant(CHAIN, schedule=str(path))
    again.restore(after.snapshot())
    assert again.state(0).step == "end"


@pytest.mark.parametrize(
    ("statement", "is_damage"),
    [
        ("UPDATE plant SET stamp_ns = 'x'", True),
        ("UPDATE plant SET snapshot = '{'", True),
        ("INSERT INTO outbox VALUES (1, 'x')", True),
        ("""UPDATE plant SET snapshot = '{"prefix": "of another version"}'""", False),
    ],
)
def test_unusable_snapshot_is_not_restored_and_set_aside_if_damaged(
    tmp_path: Path, statement: str, is_damage: object
) -> None:
    persistence = PlantPersistence(config(), tmp_path)
    one = plant(FORK)
    persistence.resume(one, "mark", S)
    persistence.save(one, "mark", S)
    persistence.close()
    with contextlib.closing(sqlite3.connect(tmp_path / FILE)) as db, db:
        db.execute(statement)
    assert persistence.resume(one, "mark", S) == ()
    assert ("plant.sqlite was damaged and is now plant.corrupt-" in persistence.problem) == is_damage
    persistence.close()


def test_other_maps_configurations_and_versions_have_other_marks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mark = fingerprint(CHAIN, config())
    assert mark == fingerprint(CHAIN.model_copy(update={"stamp_ns": 9}), config(rate_hz=50.0))
    assert mark != fingerprint(FORK, config())
    assert mark != fingerprint(CHAIN, config(speed_mps=1.0))
    with monkeypatch.context() as other:
        other.setattr(persistence, "pointit_version", lambda: "999.0.0")
        assert mark != fingerprint(CHAIN, config())
    path = tmp_path / "a.yaml"
    path.write_text("steps: {}")
    one = fingerprint(CHAIN, config(schedule=str(path)))
    path.write_text("steps: {1: {}}")
    assert one != fingerprint(CHAIN, config(schedule=str(path)))
