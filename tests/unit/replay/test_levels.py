"""Division of a recording into its edge and what is recomputed; the recorded map as a file."""

from pathlib import Path
from typing import Any

import pytest

from pointit.maps.file import load_map, shipped_maps
from pointit.recording.entries import AnyRow, entry
from pointit.replay.replayed_services import Level, ReplayError, Split, check_map, write_room
from pointit.schemas import Environment, Feedback, ImuSample, PointingRay, SelectionEvent, UserPose, topics
from pointit.schemas.environment import Box, Cloud, Cylinder, Fence, Plane, Sphere, Thing

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


def test_a_recording_without_configurations_is_refused_with_what_is_missing() -> None:
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


def test_a_map_with_clouds_is_not_written_since_its_points_are_not_in_the_message(tmp_path: Path) -> None:
    cloud = Cloud(id="scan", points=9, low_m=(0.0, 0.0, 0.0), high_m=(1.0, 1.0, 1.0))
    assert write_room(load_map("lab", 5).model_copy(update={"clouds": (cloud,)}), tmp_path) is None
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["../../outside", "/outside", "a\0b", "", "..", "x" * 5000])
def test_a_map_with_a_hostile_name_is_written_into_the_folder(name: str, tmp_path: Path) -> None:
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
