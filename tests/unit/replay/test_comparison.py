"""The beginning of a replay, and its comparison with the recording."""

from pathlib import Path
from typing import Any

import pytest

from pointit.cli.recordings.replay import first_lines
from pointit.maps.file import load_map, shipped_maps
from pointit.recording.entries import AnyRow, entry
from pointit.replay.comparison import Comparison, ComparisonReport, Leaf, Sample, TopicReport, differences
from pointit.replay.replayed_services import Level, ReplayError, Split, check_map, write_room
from pointit.schemas import Environment, Feedback, ImuSample, PointingRay, SelectionEvent, UserPose, topics
from pointit.schemas.environment import Box, Cloud, Cylinder, Fence, Plane, Sphere, Thing

MS = 1_000_000
RAY = "users/anna/ray"
POSE = "users/anna/pose"
CURSOR = "users/anna/cursor"


def sample(key: str, at_ms: int, stamp_ms: int | None = None, **content: Any) -> Sample:
    stamp_ns = (at_ms if stamp_ms is None else stamp_ms) * MS
    return Sample(key, at_ms * MS, stamp_ns, {"stamp_ns": stamp_ns, **content})


def report(
    recorded: list[Sample], replayed: list[Sample], *, time_tolerance_s: float = 0.1
) -> ComparisonReport:
    comparison = Comparison(time_tolerance_s=time_tolerance_s)
    there = [each.time_ns for each in (*recorded, *replayed)]
    for time_ns in sorted(set(there)):
        for each in recorded:
            if each.time_ns == time_ns:
                comparison.add("recorded", each)
        for each in replayed:
            if each.time_ns == time_ns:
                comparison.add("replayed", each)
    return comparison.finish()


def one(recorded: list[Sample], replayed: list[Sample], **options: float) -> TopicReport:
    (topic,) = report(recorded, replayed, **options).topics
    return topic


def test_equal_runs_have_no_difference() -> None:
    both = [sample(RAY, at, direction=(1.0, 0.0, 0.0)) for at in range(0, 5000, 20)]
    found = report(both, both)
    assert found.is_same
    assert found.first is None
    assert found.topics[0].recorded == found.topics[0].replayed == 250


@pytest.mark.parametrize(
    ("key", "change", "differ"), [(RAY, 5e-10, 0), (RAY, 5e-9, 1), (POSE, 5e-7, 0), (POSE, 5e-6, 1)]
)
def test_numbers_differ_beyond_the_tolerance_of_their_topic(key: str, change: float, differ: int) -> None:
    topic = one([sample(key, 0, x=1.0)], [sample(key, 0, x=1.0 + change)])
    assert topic.differ == differ


def test_largest_difference_is_reported_by_field_with_the_first_message() -> None:
    before = [sample(CURSOR, at, point_m=(0.0, 0.0, 1.0)) for at in (0, 20, 40)]
    after = [
        sample(CURSOR, at, point_m=(0.0, x, 1.0)) for at, x in zip((0, 20, 40), (0.0, 0.1, -0.3), strict=True)
    ]
    topic = one(before, after)
    assert (topic.differ, topic.only_recorded, topic.only_replayed) == (2, 0, 0)
    assert [(each.field, each.differ, each.largest) for each in topic.fields] == [("point_m", 2, 0.3)]
    assert topic.first is not None
    assert topic.first.time_ns == 20 * MS
    assert topic.first.recorded == before[1].content
    assert topic.first.replayed == after[1].content


def test_a_lost_message_is_missing_and_the_others_stay_paired() -> None:
    both = [sample(CURSOR, at, x=float(at)) for at in range(0, 200, 20)]
    topic = one(both, both[:3] + both[4:])
    assert (topic.differ, topic.only_recorded, topic.only_replayed) == (0, 1, 0)
    topic = one(both[:3] + both[4:], both)
    assert (topic.differ, topic.only_recorded, topic.only_replayed) == (0, 0, 1)


def test_a_message_with_another_stamp_is_paired_by_its_time() -> None:
    topic = one([sample(CURSOR, 0, x=1.0)], [sample(CURSOR, 3, x=1.0)])
    assert topic.is_same
    assert topic.shift_s == 0.003
    exact = one([sample(CURSOR, 0, x=1.0)], [sample(CURSOR, 3, x=1.0)], time_tolerance_s=0.0)
    assert exact.differ == 1
    far = one([sample(CURSOR, 0, x=1.0)], [sample(CURSOR, 900, x=1.0)])
    assert (far.only_recorded, far.only_replayed) == (1, 1)


def test_memory_is_bounded_when_only_one_side_writes() -> None:
    comparison = Comparison()
    for at in range(0, 100_000, 20):
        comparison.add("replayed", sample(RAY, at, x=1.0))
    assert sum(len(each) for each in comparison._topics[RAY].waiting.values()) < 200


@pytest.mark.parametrize(
    ("before", "after", "leaf"),
    [
        ({"a": {"b": [1.0, 2.0]}}, {"a": {"b": [1.0, 2.5]}}, Leaf("a.b", 0.5)),
        ({"until_ns": 2_000_000_000}, {"until_ns": 500_000_000}, Leaf("until_ns", 1.5)),
        ({"rgb": b"\x00\x05"}, {"rgb": b"\x00\xff"}, Leaf("rgb", 250.0, is_exact=True)),
        ({"name": "a"}, {"name": "b"}, Leaf("name", None)),
        ({"seen": True}, {"seen": False}, Leaf("seen", None)),
        ({"items": [1]}, {"items": [1, 2]}, Leaf("items", None)),
        ({"x": None}, {"x": 1.0}, Leaf("x", None)),
    ],
)
def test_differences_name_field_and_size(before: dict[str, Any], after: dict[str, Any], leaf: Leaf) -> None:
    assert differences(before, after) == [leaf]
    assert differences(before, before) == []


def test_first_divergence_shows_only_differing_strips_and_their_pixel() -> None:
    def frame(red: int) -> Sample:
        strips = [{"id": "1", "rgb": bytes(6)}, {"id": "2", "rgb": bytes([0, 0, 0, red, 20, 30])}]
        return sample("strips/frame", 0, strips=strips)

    _, recorded, replayed = first_lines(report([frame(10)], [frame(11)]), 0)
    assert recorded == '- recorded: {stamp_ns: 0, strips: [{id: "2", rgb: {pixel: 1, rgb: [10, 20, 30]}}]}'
    assert replayed == recorded.replace("recorded", "replayed").replace("10", "11")


ALL = (
    "pui",
    "selector",
    "led-driver",
    "conveyor-sim",
    "user-sim.anna",
    "supervisor.anna",
    "pointing.anna",
    "localizer.anna",
)
SAMPLE = ImuSample(stamp_ns=1, orientation_xyzw=(0.0, 0.0, 0.0, 1.0))
A_RAY = PointingRay(stamp_ns=1, origin_m=(0.0, 0.0, 1.6), direction=(1.0, 0.0, 0.0))


def pose(**fields: Any) -> UserPose:
    return UserPose(stamp_ns=1, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0, **fields)


def event(kind: Any) -> SelectionEvent:
    return SelectionEvent(stamp_ns=1, event=kind, object_id="a")


@pytest.mark.parametrize(
    ("row", "name", "body", "levels"),
    [
        (topics.IMU, "anna", SAMPLE, ""),
        (topics.RAY, "anna", A_RAY, "edge"),
        (topics.RAY, "ben", A_RAY, ""),
        (topics.POSE, "anna", pose(), "edge"),
        (topics.POSE, "anna", pose(method="external"), ""),
        (topics.SELECTION_EVENTS, "", event("selected"), "edge rays cursors"),
        (topics.SELECTION_EVENTS, "", event("left"), ""),
        (topics.FEEDBACK, "anna", Feedback(stamp_ns=1, cue="started"), "edge rays"),
        (topics.FEEDBACK, "anna", Feedback(stamp_ns=1, cue="selected"), "edge rays cursors"),
        (topics.SERVICE_ALIVE, "pointing.anna", True, "edge"),
        (topics.SERVICE_ALIVE, "user-sim.anna", True, ""),
        (topics.SHARD_ALIVE, "pui.anna", True, "edge rays"),
        (topics.USER_ALIVE, "anna", True, ""),
    ],
)
def test_entry_is_recomputed_where_its_writer_runs(row: AnyRow, name: str, body: Any, levels: str) -> None:
    said = entry(1, row, name, body)
    every: tuple[Level, ...] = ("edge", "rays", "cursors")
    assert [level for level in every if Split(level, ALL).is_recomputed(said)] == levels.split()


def test_recording_without_configurations_is_refused_with_the_missing_services() -> None:
    with pytest.raises(ReplayError, match=r"no configuration of any service that --from cursors replays"):
        Split("cursors", ["pointing.anna"])


def again(room: Environment, folder: Path) -> Environment:
    path = write_room(room, folder)
    assert path is not None
    return load_map(str(path), room.stamp_ns)


@pytest.mark.parametrize("name", shipped_maps())
def test_shipped_maps_are_read_again_as_they_were(name: str, tmp_path: Path) -> None:
    room = load_map(name, 5)
    assert again(room, tmp_path) == room


def test_solids_things_and_fences_are_read_again_as_they_were(tmp_path: Path) -> None:
    room = load_map("lab", 5).model_copy(
        update={
            "boxes": (Box(id="table", center_m=(1.0, 2.0, 0.4), size_m=(1.0, 0.6, 0.8), yaw_rad=0.5),),
            "planes": (
                Plane(id="floor", center_m=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0)),
                Plane(id="wall", center_m=(0.0, 3.0, 1.0), normal=(0.0, -1.0, 0.0), size_m=(4.0, 2.0)),
            ),
            "cylinders": (Cylinder(id="tank", center_m=(3.0, 0.0, 0.0), radius_m=0.4, height_m=1.5),),
            "spheres": (Sphere(id="ball", center_m=(2.0, 2.0, 1.0), radius_m=0.2),),
            "things": (
                Thing(id="kettle", center_m=(1.0, 2.0, 1.0), size_m=(0.2, 0.2, 0.3), press=True, dwell_s=2.0),
                Thing(id="agv1", center_m=(0, 0, 0), size_m=(0.2, 0.2, 0.2), mode="switch", is_tracked=True),
            ),
            "fences": (
                Fence(id="hall", kind="keep_in", outline_m=((0.0, 0.0), (9.0, 0.0), (0.0, 9.0)), low_m=0.0),
                Fence(id="desk", kind="keep_out", outline_m=((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)), high_m=1.0),
            ),
        }
    )
    assert again(room, tmp_path) == room


def test_map_with_point_clouds_is_not_written(tmp_path: Path) -> None:
    cloud = Cloud(id="scan", points=9, low_m=(0.0, 0.0, 0.0), high_m=(1.0, 1.0, 1.0))
    assert write_room(load_map("lab", 5).model_copy(update={"clouds": (cloud,)}), tmp_path) is None
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["../../outside", "/outside", "a\0b", "", "..", "x" * 5000])
def test_map_with_a_hostile_name_stays_in_the_folder(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "inside"
    folder.mkdir()
    path = write_room(load_map("lab", 5).model_copy(update={"name": name}), folder)
    assert path is not None
    assert path.resolve().parent == folder
    assert [each.name for each in tmp_path.iterdir()] == ["inside"]


@pytest.mark.parametrize(
    "name", ["../secret.yaml", "/etc/hostname", "link.yaml", "folder", "a\0b", "x" * 5000]
)
def test_map_elsewhere_is_not_opened(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = tmp_path / "here"
    (here / "folder").mkdir(parents=True)
    (tmp_path / "secret.yaml").touch()
    (here / "link.yaml").symlink_to(tmp_path / "secret.yaml")
    monkeypatch.chdir(here)
    with pytest.raises(ReplayError, match="neither shipped nor a file in the current folder"):
        check_map(name)


def test_map_that_is_shipped_or_here_is_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "mine.yaml").touch()
    monkeypatch.chdir(tmp_path)
    for name in ("lab", "maps/mine.yaml", str(tmp_path / "maps" / "mine.yaml")):
        check_map(name)
