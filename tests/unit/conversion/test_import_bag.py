"""Import of ROS bags, and frames in them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from rosbags.rosbag2 import StoragePlugin, Writer

import pointit.schemas as models
from pointit.cli.main import command
from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.recording.reader import Recording
from tests.unit.conversion.session import at
from tests.unit.ros2.scenes import jazzy, pose_at, quaternion, stamped, transform

TYPES = jazzy()
BACKWARDS = (0.0, 0.0, 1.0, 0.0)
POSE = "geometry_msgs/msg/PoseStamped"
MAP = """
belts:
  b1: {centerline: [[0, 0, 1], [4, 0, 1]], width: 0.5}
strips:
  s1: {line: [[0, 2, 1], [0, 4, 1]], pixels: 10}
"""

Said = tuple[float, str, str, Any]
"""Time, topic, type, value."""


def make(kind: str, /, **fields: Any) -> Any:
    return TYPES.make(kind, **fields)


def pose(time_s: float, place_m: Vec3, turned: Quaternion = rotation.IDENTITY) -> Any:
    return make(POSE, header=stamped(at(time_s)), pose=pose_at(place_m, turned))


def frame(time_s: float, child: str, parent: str = "world") -> Any:
    one = transform(parent, child, (1.0, 2.0, 0.0), BACKWARDS, at(time_s))
    return make("tf2_msgs/msg/TFMessage", transforms=[one])


def on(line: str, share: float) -> Any:
    return make("conveyor_msgs/msg/PositionOnStrip", name=line, position=share)


def packages(time_s: float, *placed: tuple[int, str, float]) -> Any:
    made = [
        make("conveyor_msgs/msg/Package", uid=uid, position=on(line, share), type=1, length=0.4)
        for uid, line, share in placed
    ]
    return make("conveyor_msgs/msg/PackageList", header=stamped(at(time_s)), packages=made)


def uids(*numbers: int) -> Any:
    return make("conveyor_msgs/msg/PackageUIDList", uids=np.array(numbers, dtype=np.uint32))


def pointers(line: str, share: float, *over: int) -> Any:
    met = {"position": on(line, share), "distance": 0.1, "overlay": uids(*over)}
    one = make("conveyor_msgs/msg/Pointer", **met, user_name="user1")
    return make("conveyor_msgs/msg/PointerList", pointers=[one])


ROTATION = ("/user1/metawear_ros/rotation", "geometry_msgs/msg/QuaternionStamped")
BUTTON = ("/user1/metawear_ros/button", "std_msgs/msg/Bool")
STATE = ("/user1/state_transition", "conveyor_msgs/msg/State")
PACKAGES = ("/packages", "conveyor_msgs/msg/PackageList")
SELECTED = ("/selected_packages", "conveyor_msgs/msg/PackageUIDList")
POINTERS = ("/pointers", "conveyor_msgs/msg/PointerList")


def turned(time_s: float, orientation: Quaternion = rotation.IDENTITY) -> Said:
    value = make(ROTATION[1], header=stamped(at(time_s - 0.01)), quaternion=quaternion(orientation))
    return (time_s, *ROTATION, value)


def pressed(time_s: float, *, down: bool) -> Said:
    return (time_s, *BUTTON, make("std_msgs/msg/Bool", data=down))


def state(time_s: float, name: str) -> Said:
    return (time_s, *STATE, make("conveyor_msgs/msg/State", node_name="supervisor", state=name))


def bag(path: Path, said: Sequence[Said], storage: StoragePlugin = StoragePlugin.SQLITE3) -> Path:
    """Write a bag as `ros2 bag record` does, with the types' definitions and hashes."""
    with Writer(path, version=9, storage_plugin=storage) as writer:
        connections: dict[str, Any] = {}
        for time_s, topic, kind, value in said:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=TYPES._definitions.store)
            writer.write(connections[topic], at(time_s), TYPES.encode(kind, value))
    return path


def run(source: Path, *options: str) -> Result:
    arguments = ["import", str(source), "--to", str(source.parent / "session.mcap"), *options]
    return CliRunner().invoke(command, arguments)


def imported(source: Path, *options: str) -> dict[str, list[Any]]:
    result = run(source, *options)
    assert result.exit_code == 0, result.output
    found: dict[str, list[Any]] = {}
    with Recording.open(source.parent / "session.mcap") as recording:
        for entry in recording.entries():
            assert isinstance(entry.body, models.Message)
            found.setdefault(entry.key, []).append(entry.body)
        assert recording.invalid == 0
    return found


@pytest.fixture
def room(tmp_path: Path) -> Path:
    path = tmp_path / "room.yaml"
    path.write_text(MAP)
    return path


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_a_person_of_a_bag(tmp_path: Path, storage: StoragePlugin) -> None:
    found = imported(
        bag(
            tmp_path / "bag",
            [
                turned(1.0),
                pressed(1.1, down=True),
                pressed(1.2, down=True),
                pressed(1.3, down=False),
                pressed(1.4, down=True),
                (1.5, "/user1/pointing_ray", POSE, pose(1.5, (0.0, 0.0, 1.6), BACKWARDS)),
                (1.6, "/user1/mocap_pose", POSE, pose(1.6, (1.0, 2.0, 0.0))),
                (1.7, "/tf", "tf2_msgs/msg/TFMessage", frame(1.7, "user1/human_footprint")),
                (1.8, "/tf", "tf2_msgs/msg/TFMessage", frame(1.8, "robot/base_link")),
                state(1.9, "waiting_relloc"),
            ],
            storage,
        )
    )
    assert found.keys() == {
        *(f"users/user1/{name}" for name in ("imu", "button", "ray", "pose", "interaction"))
    }
    assert found["users/user1/imu"] == [
        models.ImuSample(stamp_ns=at(0.99), seq=1, orientation_xyzw=(0.0, 0.0, 0.0, 1.0))
    ]
    assert [event.stamp_ns for event in found["users/user1/button"]] == [at(1.1), at(1.4)]
    assert all(isinstance(event, models.ButtonEvent) for event in found["users/user1/button"])

    (ray,) = found["users/user1/ray"]
    assert isinstance(ray, models.PointingRay)
    assert ray.origin_m == (0.0, 0.0, 1.6)
    assert ray.direction == pytest.approx((-1.0, 0.0, 0.0))

    measured, told = found["users/user1/pose"]
    assert isinstance(told, models.UserPose)
    assert (measured.method, measured.position_m, measured.yaw_rad) == ("external", (1.0, 2.0, 0.0), 0.0)
    assert (told.method, told.position_m) == ("fixed", (1.0, 2.0, 0.0))
    assert abs(told.yaw_rad) == pytest.approx(np.pi)
    assert found["users/user1/interaction"] == [
        models.Interaction(stamp_ns=at(1.9), seq=1, state="localizing")
    ]


def test_pose_is_imported_from_frames_that_it_names_only(tmp_path: Path) -> None:
    rays = "/user1/pointing_ray"
    places = "/user1/mocap_pose"
    said: list[Said] = []
    for count, (topic, name) in enumerate(
        (
            *((places, name) for name in ("", "world", "/world", "optitrack")),
            *((rays, name) for name in ("", "/user1/human_footprint", "world")),
        )
    ):
        value = pose(1.0 + count, (1.0, 2.0, 0.0))
        value.header.frame_id = name
        said.append((1.0 + count, topic, POSE, value))

    source = bag(tmp_path / "bag", said)
    assert {key: len(each) for key, each in imported(source).items()} == {
        "users/user1/pose": 3,
        "users/user1/ray": 2,
    }

    (tmp_path / "session.mcap").unlink()
    output = run(source).output
    assert "the pose of user1 is in the frame 'optitrack': transform it to 'world' first" in output
    assert "the ray of user1 is in the frame 'world'" in output


def test_packages_and_pointers_get_their_places_by_the_map(tmp_path: Path, room: Path) -> None:
    found = imported(
        bag(
            tmp_path / "bag",
            [
                (1.0, *PACKAGES, packages(1.0, (7, "b1", 0.25))),
                (1.5, *PACKAGES, packages(1.5, (7, "b1", 0.375), (8, "strip_s1", 0.5))),
                (1.5, *POINTERS, pointers("b1", 0.5, 7)),
                (1.6, *POINTERS, pointers("", 0.0)),
                (1.7, *SELECTED, uids(7)),
                (1.8, *SELECTED, uids(7)),
                (1.9, *SELECTED, uids(8)),
            ],
        ),
        *("--map", str(room)),
    )
    assert found["map"][0].stamp_ns == at(1.0)

    first, second = found["objects/conveyor"]
    assert isinstance(first, models.TrackedObjects)
    (item,) = first.objects
    assert (item.id, item.kind, item.surface, item.surface_id) == ("7", "red", "belt", "b1")
    assert (item.position_m, item.surface_position_m) == ((1.0, 0.0, 1.0), 1.0)
    assert second.objects[0].surface_speed_mps == pytest.approx(1.0)
    assert (second.objects[1].surface, second.objects[1].position_m) == ("strip", (0.0, 3.0, 1.0))

    met, missed = found["users/user1/cursor"]
    assert isinstance(met, models.Cursor)
    assert (met.surface, met.point_m, missed.surface) == ("belt", (2.0, 0.0, 1.0), "none")
    assert [hover.object_id for hover in found["users/user1/hover"]] == ["7", ""]
    assert all(isinstance(hover, models.Hover) for hover in found["users/user1/hover"])

    events = found["selection/events"]
    assert all(isinstance(event, models.SelectionEvent) for event in events)
    assert [(event.event, event.object_id) for event in events] == [
        ("selected", "7"),
        ("deselected", "7"),
        ("selected", "8"),
    ]


def test_omitted_messages_are_reported_with_the_reason(tmp_path: Path) -> None:
    source = bag(
        tmp_path / "bag",
        [
            turned(1.0),
            turned(1.1, (0.0, 0.0, 0.0, 0.0)),
            state(1.2, "dancing"),
            (1.3, *PACKAGES, packages(1.3, (7, "b1", 0.25))),
            (1.4, "/chatter", "std_msgs/msg/Bool", make("std_msgs/msg/Bool", data=True)),
            (1.5, "/user1/metawear_ros/button", "std_msgs/msg/UInt8", make("std_msgs/msg/UInt8", data=1)),
            (1.6, f"/{'a' * 70}/metawear_ros/rotation", *turned(1.6)[2:]),
        ],
    )
    result = run(source)
    assert result.exit_code == 0, result.output
    assert "/user1/metawear_ros/rotation: 1 messages" in result.stdout

    notes = {
        line.split(": ")[1]: line.split(": 1 messages left out, ")[1] for line in result.stderr.splitlines()
    }
    assert "the norm of its quaternion is 0" in notes["/user1/metawear_ros/rotation"]
    assert notes["/user1/state_transition"] == "the state 'dancing' is unknown"
    assert notes["/packages"] == "its places need the room; give it by --map"
    assert notes["/chatter"] == "a recording has no place for it"
    assert "its type is std_msgs/msg/UInt8" in notes["/user1/metawear_ros/button"]
    assert "use 1 to 64 letters" in notes[f"/{'a' * 70}/metawear_ros/rotation"]


def test_foreign_clock_stamps_are_refused_unless_bag_time_is_chosen(tmp_path: Path) -> None:
    source = bag(tmp_path / "bag", [(100.0, *turned(1.0)[1:])])
    refusal = run(source).stderr
    assert "s from the bag's time, limit 10 s; give --stamps bag if it is of another clock" in refusal
    assert imported(source, "--stamps", "bag")["users/user1/imu"][0].stamp_ns == at(100.0)


def test_bag_without_anything_to_record_writes_nothing_and_says_why(tmp_path: Path) -> None:
    source = bag(
        tmp_path / "bag", [(1.4, "/chatter", "std_msgs/msg/Bool", make("std_msgs/msg/Bool", data=True))]
    )
    result = run(source)
    assert "nothing in the source can be recorded" in str(result.exception or result.output)
    assert "/chatter: 1 messages left out, a recording has no place for it" in result.stderr
    assert not (tmp_path / "session.mcap").exists()


def test_unreadable_frame_is_named_and_the_others_are_kept(tmp_path: Path) -> None:
    names = ("anna", "/world"), ("ben", "optitrack"), ("eve", "world"), ("finn", "world")
    frames = [frame(1.0, f"{user}/human_footprint", parent).transforms[0] for user, parent in names]
    frames[2].transform.translation.x = 1e9
    said: list[Said] = [
        (1.0, "/tf", "tf2_msgs/msg/TFMessage", make("tf2_msgs/msg/TFMessage", transforms=frames))
    ]
    source = bag(tmp_path / "bag", said)
    assert sorted(imported(source)) == ["users/anna/pose", "users/finn/pose"]
    (tmp_path / "session.mcap").unlink()
    sentence = "the pose of ben is in the frame 'optitrack': transform it to 'world' first"
    assert sentence in " ".join(run(source).output.split())
