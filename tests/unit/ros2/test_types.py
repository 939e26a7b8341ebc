"""ROS values, their CDR and their names."""

import contextlib
import json
import struct
import tracemalloc
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pointit.bridges.ros2.types import types
from pointit.bridges.ros2.types.definitions import INTERFACES
from pointit.bridges.ros2.types.types import Types
from pointit.runtime.errors import ConfigError
from tests.unit.ros2.values import golden, plain

CDR: dict[str, str] = golden("cdr")
STAMP = {"sec": 1700000000, "nanosec": 123456789}
HEADER = {"stamp": STAMP, "frame_id": "user1/human_footprint"}
PLACE = {"position": {"x": 1.0, "y": 2.0, "z": 3.0}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
TURNED = {"x": 0.1, "y": 0.2, "z": 0.3, "w": 0.9}
STRIP = {"color_order": 1, "type": 0, "id": 3, "data": list(range(9))}


@pytest.fixture(scope="module")
def jazzy() -> Types:
    return Types("jazzy")


def test_cdr_of_a_running_node(jazzy: Types) -> None:
    assert len(CDR) == 28
    for name, text in CDR.items():
        theirs = bytes.fromhex(text)
        value = jazzy.decode(name, theirs)
        ours = jazzy.encode(name, value)
        assert plain(jazzy.decode(name, ours)) == plain(value)
        # Genuine padding is whatever lay in memory; ours is zero.
        assert len(ours) <= len(theirs)
        differing = [at for at, byte in enumerate(ours) if byte != theirs[at]]
        assert not any(ours[at] for at in differing)
        if name != "sensor_msgs/msg/JointState":  # the only one with more than alignment behind it
            assert len(theirs) - len(ours) <= 3


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("geometry_msgs/msg/PoseStamped", {"header": HEADER, "pose": PLACE}),
        ("geometry_msgs/msg/QuaternionStamped", {"header": HEADER, "quaternion": TURNED}),
        ("led_strip_msgs/msg/LedStrips", {"strips": [STRIP]}),
        ("conveyor_msgs/msg/BeltCommand", {"name": ["*", "b1"], "velocity": [0.25, 0.5]}),
        ("conveyor_msgs/msg/State", {"node_name": "supervisor", "state": "relloc_done"}),
        ("conveyor_msgs/srv/AddPack_Request", {"uid": 41, "kind": 1, "position": 0.5, "belt": 2}),
        ("conveyor_msgs/srv/AddPack_Response", {"result": True}),
        ("std_srvs/srv/Trigger_Response", {"success": True, "message": "ok"}),
        ("std_msgs/msg/String", {"data": "h\u00e9llo"}),
    ],
)
def test_what_a_running_node_meant(jazzy: Types, name: str, expected: dict[str, Any]) -> None:
    assert plain(jazzy.decode(name, bytes.fromhex(CDR[name]))) == expected


def test_calls_on_the_wire(jazzy: Types) -> None:
    wire, add = golden("wire"), "conveyor_msgs/srv/AddPack"
    for uid, call in enumerate(wire["calls"], start=41):
        request = jazzy.make(f"{add}_Request", uid=uid, kind=1, position=0.5, belt=2)
        assert jazzy.encode(jazzy.request_of(add), request).hex() == call["request_payload"]
        response = jazzy.make(f"{add}_Response", result=True)
        assert jazzy.encode(jazzy.response_of(add), response).hex() == call["reply_payload"]
        assert call["key"].endswith(jazzy.kind(add).hash)


def test_a_structure_without_fields_is_one_byte(jazzy: Types) -> None:
    for name in ("msgs/msg/Empty", "srvs/srv/Empty_Request"):
        assert jazzy.encode(f"std_{name}", jazzy.make(f"std_{name}")) == b"\x00\x01\x00\x00\x00"


def test_fields_not_given_have_the_defaults_of_ros(jazzy: Types) -> None:
    pose = jazzy.make("geometry_msgs/msg/PoseStamped")
    assert plain(pose.pose.orientation) == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    assert plain(pose.header) == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert jazzy.make("geometry_msgs/msg/PoseStamped").pose is not pose.pose
    effect = jazzy.make("led_strip_msgs/msg/LedEffect", effect=2)
    assert (effect.times, effect.effect, effect.FLASH) == (-1, 2, 2)
    assert jazzy.make("led_strip_msgs/srv/SetBrightness_Request").channel_index_mask == 255
    imu = jazzy.make("sensor_msgs/msg/Imu")
    assert plain(imu.orientation_covariance) == [0.0] * 9
    assert jazzy.make("conveyor_msgs/msg/PointerList").pointers == []
    assert jazzy.make("std_msgs/msg/Bool").data is False


@pytest.mark.parametrize("distro", ["humble", "lyrical"])
def test_every_type_has_defaults_that_can_be_sent(distro: Any) -> None:
    kinds, checked = Types(distro), 0
    begin = ("std_", "geo", "sens", "vis", "diag", "nav_", "conv", "led", "tf2", "rosg")
    for name in golden("hashes"):
        if name.endswith("_Event") or not name.startswith(begin):
            continue
        try:
            value = kinds.make(name)
        except KeyError:
            continue
        checked += 1
        assert plain(kinds.decode(name, kinds.encode(name, value))) == plain(value)
    assert checked > 110


def strips(jazzy: Types, data: Any) -> Any:
    return jazzy.make(
        "led_strip_msgs/msg/LedStrips", strips=[jazzy.make("led_strip_msgs/msg/LedStrip", data=data)]
    )


@pytest.mark.parametrize(
    "data",
    [
        *(b"\1\2\377", bytearray(b"\1\2\377"), memoryview(b"\1\2\377"), [1, 2, 255], (1, 2, 255)),
        *(np.array([1, 2, 255]), np.array([1, 2, 255], np.uint8), np.array([1, 0, 2, 0, 255], np.uint8)[::2]),
    ],
)
def test_lists_of_numbers_may_be_given_as_anything(jazzy: Types, data: Any) -> None:
    cdr = jazzy.encode("led_strip_msgs/msg/LedStrips", strips(jazzy, data))
    assert cdr.endswith(b"\3\0\0\0\1\2\377")


def test_there_is_no_such_field(jazzy: Types) -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'value'"):
        jazzy.make("std_msgs/msg/Bool", value=True)


BAD: list[tuple[str, dict[str, Any], str]] = [
    ("std_msgs/msg/Float32", {"data": 1e39}, r"too large"),
    ("std_msgs/msg/Float64", {"data": "1.0"}, r"cannot be encoded"),
    ("std_msgs/msg/Float64", {"data": 10**400}, r"cannot be encoded"),
    ("std_msgs/msg/UInt8", {"data": 256}, r"cannot be encoded"),
    ("std_msgs/msg/UInt8", {"data": 1.0}, r"cannot be encoded"),
    ("std_msgs/msg/Int64", {"data": 2**63}, r"cannot be encoded"),
    ("std_msgs/msg/String", {"data": "\ud800"}, r"cannot be encoded"),
    ("sensor_msgs/msg/Imu", {"orientation_covariance": [0.0] * 8}, r"cannot be encoded"),
    ("sensor_msgs/msg/Imu", {"orientation": None}, r"cannot be encoded"),
    ("tf2_msgs/msg/TFMessage", {"transforms": [None]}, r"cannot be encoded"),
    ("tf2_msgs/msg/TFMessage", {"transforms": None}, r"cannot be encoded"),
    ("tf2_msgs/msg/TFMessage", {"transforms": iter([])}, r"cannot be encoded"),
]


@pytest.mark.parametrize(("name", "fields", "problem"), BAD)
def test_what_does_not_fit_its_type_is_not_encoded(
    jazzy: Types, name: str, fields: dict[str, Any], problem: str
) -> None:
    with pytest.raises(ValueError, match=problem) as caught:
        jazzy.encode(name, jazzy.make(name, **fields))
    assert str(caught.value).startswith(name)


@pytest.mark.parametrize(
    ("cdr", "problem"),
    [
        (b"", "is not CDR, begins with nothing"),
        (b"\x00\x01", "cannot be decoded"),
        (b"\x00\x03\x00\x00\x01", "is not CDR, begins with 00 03 00 00"),  # parameter list
        (b"\x00\x07\x00\x00\x01", "is not CDR"),  # XCDR 2
        (b"\x00\x01\x00\x00", "cannot be decoded"),
        (b"\x00\x01\x00\x00" + bytes(1_000_000), "1000004 bytes, at most 1000000 are read"),
    ],
)
def test_what_is_no_cdr_is_refused(jazzy: Types, cdr: bytes, problem: str) -> None:
    with pytest.raises(ValueError, match=f"std_msgs/msg/Bool: {problem}"):
        jazzy.decode("std_msgs/msg/Bool", cdr)


def test_the_size_that_is_read_is_given_and_what_is_behind_is_ignored(jazzy: Types) -> None:
    name = "std_msgs/msg/String"
    cdr = jazzy.encode(name, jazzy.make(name, data="a" * 11))
    assert jazzy.decode(name, cdr, max_bytes=20).data == "a" * 11
    with pytest.raises(ValueError, match="20 bytes, at most 19 are read"):
        jazzy.decode(name, cdr, max_bytes=19)
    assert jazzy.decode(name, cdr + b"garbage behind").data == "a" * 11
    assert jazzy.decode("std_msgs/msg/Int32", b"\x00\x00\x00\x00" + struct.pack(">i", 7)).data == 7


@pytest.mark.parametrize(
    "name",
    [
        *("tf2_msgs/msg/TFMessage", "visualization_msgs/msg/MarkerArray", "std_msgs/msg/String"),
        *(f"conveyor_msgs/msg/{name}" for name in ("PackageUIDList", "PointerList", "BeltCommand")),
        *("led_strip_msgs/msg/LedStrips", "led_strip_msgs/msg/ColorArray"),
    ],
)
@pytest.mark.parametrize("claimed", [2**32 - 1, 2**31, 2**28, 100_000])
def test_a_length_that_the_bytes_cannot_fill_allocates_nothing(jazzy: Types, name: str, claimed: int) -> None:
    jazzy.prepare(name)
    cdr = b"\x00\x01\x00\x00" + struct.pack("<I", claimed) + bytes(4096)
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match="cannot be decoded"):
            jazzy.decode(name, cdr)
        assert tracemalloc.get_traced_memory()[1] < 200_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "name", ["std_msgs/msg/Boolean", "std_msgs/Bool", "Bool", "", "std_srvs/srv/Nothing"]
)
def test_an_unknown_type_is_told_in_a_sentence(jazzy: Types, name: str) -> None:
    for ask in (jazzy.kind, jazzy.make, jazzy.prepare, partial(jazzy.decode, cdr=b"")):
        with pytest.raises(KeyError) as caught:
            ask(name)
        assert caught.value.args[0] == f"{name} is not a type that ROS 2 jazzy or PointIt defines"
    with pytest.raises(KeyError, match="is not a service the bridge knows"):
        jazzy.request_of(name)


def test_humble_writes_no_hashes() -> None:
    humble = Types("humble")
    for name in ("std_srvs/srv/Empty", "conveyor_msgs/msg/State"):
        assert humble.kind(name).hash == "TypeHashNotSupported"
    with pytest.raises(KeyError, match="ROS 2 humble"):
        humble.kind("std_msgs/msg/Nothing")


@pytest.mark.parametrize("distro", ["jazzy", "lyrical"])
def test_our_hashes_are_those_of_ros(distro: Any) -> None:
    kinds = Types(distro)
    for name, expected in json.loads(types.GOLDEN.read_text(encoding="utf-8")).items():
        with contextlib.suppress(KeyError):  # rosbags does not bring it
            assert kinds.kind(name).hash == expected


def test_another_hash_stops_the_bridge(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    other = tmp_path / "golden.json"
    other.write_text('{"std_msgs/msg/Bool": "RIHS01_0"}', encoding="utf-8")
    monkeypatch.setattr(types, "GOLDEN", other)
    told = r"std_msgs/msg/Bool: the hash .* in ROS 2 it is RIHS01_0; remove "
    for use in (Types("jazzy").prepare, Types("jazzy").kind):
        with pytest.raises(ConfigError, match=told):
            use("std_msgs/msg/Bool")


def test_what_is_shipped_knows_every_hash_of_ours() -> None:
    ours = golden("hashes")
    shipped: dict[str, str] = json.loads(types.GOLDEN.read_text(encoding="utf-8"))
    for path in INTERFACES.glob("*/*/*.[ms][sr][gv]"):
        name = f"{path.parts[-3]}/{path.parts[-2]}/{path.stem}"
        assert shipped[name] == f"RIHS01_{ours[name]['hash']}"
    assert {name: each.removeprefix("RIHS01_") for name, each in shipped.items()}.items() <= {
        name: each["hash"] for name, each in ours.items()
    }.items()
