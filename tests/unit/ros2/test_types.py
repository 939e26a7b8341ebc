"""ROS types: definitions and hashes of a running ROS 2, packages for colcon, values and their CDR."""

import contextlib
import json
import re
import struct
import sys
import tracemalloc
from functools import partial
from importlib.resources import files
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, Literal
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.graph.backend import Distro
from pointit.bridges.ros2.over_rclpy.rclpy_library import class_of
from pointit.bridges.ros2.types import types
from pointit.bridges.ros2.types.definitions import INTERFACES, NAVIGATE_TO_POSE, Definitions, Rihs01, actions
from pointit.bridges.ros2.types.types import Types
from pointit.runtime.errors import ConfigError
from tests.unit.ros2.scenes import jazzy
from tests.unit.ros2.values import any_value, definitions, golden, plain

CDR: dict[str, str] = golden("cdr")
STAMP = {"sec": 1700000000, "nanosec": 123456789}
HEADER = {"stamp": STAMP, "frame_id": "user1/human_footprint"}
PLACE = {"position": {"x": 1.0, "y": 2.0, "z": 3.0}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
TURNED = {"x": 0.1, "y": 0.2, "z": 0.3, "w": 0.9}
STRIP = {"color_order": 1, "type": 0, "id": 3, "data": list(range(9))}


def test_cdr_of_a_running_node() -> None:
    assert len(CDR) == 28
    for name, text in CDR.items():
        theirs = bytes.fromhex(text)
        value = jazzy().decode(name, theirs)
        ours = jazzy().encode(name, value)
        assert plain(jazzy().decode(name, ours)) == plain(value)
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
def test_messages_of_a_running_node_are_decoded(name: str, expected: dict[str, Any]) -> None:
    assert plain(jazzy().decode(name, bytes.fromhex(CDR[name]))) == expected


def test_calls_on_the_wire() -> None:
    wire = golden("wire")
    add = "conveyor_msgs/srv/AddPack"
    for uid, call in enumerate(wire["calls"], start=41):
        request = jazzy().make(f"{add}_Request", uid=uid, kind=1, position=0.5, belt=2)
        assert jazzy().encode(jazzy().request_of(add), request).hex() == call["request_payload"]
        response = jazzy().make(f"{add}_Response", result=True)
        assert jazzy().encode(jazzy().response_of(add), response).hex() == call["reply_payload"]
        assert call["key"].endswith(jazzy().kind(add).hash)


def test_a_structure_without_fields_is_one_byte() -> None:
    for name in ("msgs/msg/Empty", "srvs/srv/Empty_Request"):
        assert jazzy().encode(f"std_{name}", jazzy().make(f"std_{name}")) == b"\x00\x01\x00\x00\x00"


def test_fields_not_given_have_the_defaults_of_ros() -> None:
    pose = jazzy().make("geometry_msgs/msg/PoseStamped")
    assert plain(pose.pose.orientation) == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    assert plain(pose.header) == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert jazzy().make("geometry_msgs/msg/PoseStamped").pose is not pose.pose
    effect = jazzy().make("led_strip_msgs/msg/LedEffect", effect=2)
    assert (effect.times, effect.effect, effect.FLASH) == (-1, 2, 2)
    assert jazzy().make("led_strip_msgs/srv/SetBrightness_Request").channel_index_mask == 255
    imu = jazzy().make("sensor_msgs/msg/Imu")
    assert plain(imu.orientation_covariance) == [0.0] * 9
    assert jazzy().make("conveyor_msgs/msg/PointerList").pointers == []
    assert jazzy().make("std_msgs/msg/Bool").data is False


@pytest.mark.parametrize("distro", ["humble", "lyrical"])
def test_every_type_has_defaults_that_can_be_sent(distro: Any) -> None:
    kinds = Types(distro)
    checked = 0
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


def strips(data: Any) -> Any:
    return jazzy().make(
        "led_strip_msgs/msg/LedStrips", strips=[jazzy().make("led_strip_msgs/msg/LedStrip", data=data)]
    )


@pytest.mark.parametrize(
    "data",
    [
        *(b"\1\2\377", bytearray(b"\1\2\377"), memoryview(b"\1\2\377"), [1, 2, 255], (1, 2, 255)),
        *(np.array([1, 2, 255]), np.array([1, 2, 255], np.uint8), np.array([1, 0, 2, 0, 255], np.uint8)[::2]),
    ],
)
def test_lists_of_numbers_may_be_given_as_anything(data: Any) -> None:
    cdr = jazzy().encode("led_strip_msgs/msg/LedStrips", strips(data))
    assert cdr.endswith(b"\3\0\0\0\1\2\377")


def test_unknown_field_is_an_error() -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'value'"):
        jazzy().make("std_msgs/msg/Bool", value=True)


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
def test_value_that_does_not_fit_its_type_is_not_encoded(
    name: str, fields: dict[str, Any], problem: str
) -> None:
    with pytest.raises(ValueError, match=problem) as caught:
        jazzy().encode(name, jazzy().make(name, **fields))
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
def test_invalid_cdr_is_refused(cdr: bytes, problem: str) -> None:
    with pytest.raises(ValueError, match=f"std_msgs/msg/Bool: {problem}"):
        jazzy().decode("std_msgs/msg/Bool", cdr)


def test_decoding_is_limited_in_size_and_ignores_padding() -> None:
    name = "std_msgs/msg/String"
    cdr = jazzy().encode(name, jazzy().make(name, data="a" * 11))
    assert jazzy().decode(name, cdr, max_bytes=20).data == "a" * 11
    with pytest.raises(ValueError, match="20 bytes, at most 19 are read"):
        jazzy().decode(name, cdr, max_bytes=19)
    assert jazzy().decode(name, cdr + b"garbage behind").data == "a" * 11
    assert jazzy().decode("std_msgs/msg/Int32", b"\x00\x00\x00\x00" + struct.pack(">i", 7)).data == 7


@pytest.mark.parametrize(
    "name",
    [
        *("tf2_msgs/msg/TFMessage", "visualization_msgs/msg/MarkerArray", "std_msgs/msg/String"),
        *(f"conveyor_msgs/msg/{name}" for name in ("PackageUIDList", "PointerList", "BeltCommand")),
        *("led_strip_msgs/msg/LedStrips", "led_strip_msgs/msg/ColorArray"),
    ],
)
@pytest.mark.parametrize("claimed", [2**32 - 1, 2**31, 2**28, 100_000])
def test_a_length_that_the_bytes_cannot_fill_allocates_nothing(name: str, claimed: int) -> None:
    jazzy().prepare(name)
    cdr = b"\x00\x01\x00\x00" + struct.pack("<I", claimed) + bytes(4096)
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match="cannot be decoded"):
            jazzy().decode(name, cdr)
        assert tracemalloc.get_traced_memory()[1] < 200_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "name", ["std_msgs/msg/Boolean", "std_msgs/Bool", "Bool", "", "std_srvs/srv/Nothing"]
)
def test_unknown_type_is_reported_in_a_sentence(name: str) -> None:
    for ask in (jazzy().kind, jazzy().make, jazzy().prepare, partial(jazzy().decode, cdr=b"")):
        with pytest.raises(KeyError) as caught:
            ask(name)
        assert caught.value.args[0] == f"{name} is not a type that ROS 2 jazzy or PointIt defines"
    with pytest.raises(KeyError, match="is not a service the bridge knows"):
        jazzy().request_of(name)


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


def test_shipped_hashes_cover_all_used_types() -> None:
    ours = golden("hashes")
    shipped: dict[str, str] = json.loads(types.GOLDEN.read_text(encoding="utf-8"))
    for path in INTERFACES.glob("*/*/*.[ms][sr][gv]"):
        name = f"{path.parts[-3]}/{path.parts[-2]}/{path.stem}"
        assert shipped[name] == f"RIHS01_{ours[name]['hash']}"
    assert {name: each.removeprefix("RIHS01_") for name, each in shipped.items()}.items() <= {
        name: each["hash"] for name, each in ours.items()
    }.items()


def computed(hashes: Rihs01, name: str) -> str:
    """Our description of a message, a service, or one of a service's halves or events."""
    if "/srv/" not in name or name.endswith(("_Request", "_Response")):
        return hashes.message(name)
    service = name.partition("_Event")[0]
    of_service = hashes.service(service)
    return of_service if service == name else hashes.message(name)


@pytest.mark.parametrize(("distro", "count"), [("jazzy", 296), ("kilted", 269)])
def test_every_known_hash_is_computed(distro: Literal["jazzy", "kilted"], count: int) -> None:
    extra = definitions()
    store = Definitions(distro).store
    hashes = Rihs01(lambda name: extra[name] if name in extra else store.fielddefs[name][1])
    known = {name: each["hash"] for name, each in golden("hashes").items() if distro in each["in"]}
    assert len(known) == count
    assert {name: computed(hashes, name).removeprefix("RIHS01_") for name in known} == known


FIBONACCI = "test_msgs/action/Fibonacci"
HASHES = {
    (FIBONACCI, "SendGoal"): "d807633803e38e164276573cd97e9fbd71e109c290bbf4cc312a0a1c9da7bbd9",
    (FIBONACCI, "GetResult"): "5d30fdeb21d20e117aa5f36c7b4f0b6874f1a8cf7a9c038d58f1156c5737b209",
    (FIBONACCI, "FeedbackMessage"): "37487bae8cea358366b97003c1ef1ca7ce7c08df36f9e8cca496624226aee64e",
    (NAVIGATE_TO_POSE, "SendGoal"): "a4fcb3bee1bf32e21a0e541a943b221aa0826996e2c98f079b47022b256f48b5",
    (NAVIGATE_TO_POSE, "GetResult"): "12dc670d3dac446019bb61a2bef1fd92ada02d582ca70922706d933a54b07f1c",
    (NAVIGATE_TO_POSE, "FeedbackMessage"): "9d1f6fa2eb975ce733b419ac2e97b134d8ff92b6478b6559feed9a50bdfd82b3",
}
"""Type hashes of actions: of Fibonacci by a running ROS 2, the others by its generator."""


def test_hashes_of_actions_are_those_of_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    fibonacci = "int32 order\n---\nint32[] sequence\n---\nint32[] sequence\n"

    def with_fibonacci(distro: Distro) -> dict[str, str]:
        return actions(distro) | {FIBONACCI: fibonacci}

    monkeypatch.setattr("pointit.bridges.ros2.types.definitions.actions", with_fibonacci)
    types = Types("jazzy")
    for (action, part), expected in HASHES.items():
        assert types.kind(f"{action}_{part}").hash == f"RIHS01_{expected}"


PACKAGES = ("conveyor_msgs", "led_strip_msgs")


def test_interfaces_folder_has_no_other_files() -> None:
    assert sorted(path.name for path in INTERFACES.iterdir()) == list(PACKAGES)
    assert (files("pointit.bridges.ros2") / "interfaces" / "conveyor_msgs" / "package.xml").is_file()


@pytest.mark.parametrize("package", PACKAGES)
def test_manifest_builds_every_interface_file(package: str) -> None:
    folder = INTERFACES / package
    cmake = (folder / "CMakeLists.txt").read_text(encoding="utf-8")
    there = {path.relative_to(folder).as_posix() for path in folder.glob("*/*")}
    assert f"project({package})" in cmake
    assert there == set(re.findall(r'"(.+)"', cmake))
    assert all(re.fullmatch(r"(msg/[A-Z]\w+\.msg|srv/[A-Z]\w+\.srv)", name) for name in there)


@pytest.mark.parametrize("package", PACKAGES)
def test_the_manifest_names_what_is_used(package: str) -> None:
    folder = INTERFACES / package
    manifest = ET.parse(folder / "package.xml").getroot()  # noqa: S314  # our own file
    assert manifest.get("format") == "3"
    assert manifest.findtext("name") == package
    assert manifest.findtext("license") == "MIT"
    assert manifest.findtext("member_of_group") == "rosidl_interface_packages"
    assert manifest.findtext("exec_depend") == "rosidl_default_runtime"

    used = {
        name
        for path in folder.glob("*/*")
        for name in re.findall(r"^(\w+)/\w+[\s\[]", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    depends = {each.text for each in manifest.findall("depend")}
    assert used - {package} == depends

    cmake = (folder / "CMakeLists.txt").read_text(encoding="utf-8")
    assert all(f"find_package({name} REQUIRED)" in cmake for name in depends)
    assert {each.text for each in manifest.findall("buildtool_depend")} <= set(
        re.findall(r"find_package\((\w+) REQUIRED\)", cmake)
    )


def test_a_file_that_is_no_definition_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "a_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "a_msgs" / "msg" / "A.msg").write_text("uint8 -\n", encoding="utf-8")
    monkeypatch.setattr("pointit.bridges.ros2.types.definitions.INTERFACES", tmp_path)
    with pytest.raises(ConfigError, match=r"a_msgs/msg/A in .*: is not a definition of a ROS type"):
        Definitions("jazzy")


NAMES = (
    *("sensor_msgs/msg/Imu", "tf2_msgs/msg/TFMessage", "visualization_msgs/msg/Marker"),
    *("conveyor_msgs/msg/PointerList", "conveyor_msgs/msg/BeltCommand", "led_strip_msgs/msg/LedStrips"),
    *("conveyor_msgs/srv/AddPack_Request", "std_srvs/srv/Trigger_Response"),
)
"""One type for each shape that a field may have."""


@pytest.mark.parametrize("name", NAMES)
@given(data=st.data())
def test_values_survive_a_round_trip(name: str, data: st.DataObject) -> None:
    value = data.draw(any_value(name))
    cdr = jazzy().encode(name, value)
    assert cdr.startswith(b"\x00\x01\x00\x00")
    again = jazzy().decode(name, cdr)
    assert plain(again) == plain(value)
    assert jazzy().encode(name, again) == cdr
    assert plain(jazzy().decode(name, cdr + bytes(len(cdr) % 4))) == plain(value)


@pytest.mark.parametrize("name", NAMES)
@given(data=st.data())
def test_damaged_bytes_are_read_or_refused(name: str, data: st.DataObject) -> None:
    """A valid message with some bytes changed, a huge length, or a missing end."""
    cdr = bytearray(jazzy().encode(name, data.draw(any_value(name))))
    for at in data.draw(st.lists(st.integers(0, len(cdr) - 1), max_size=4)):
        cdr[at] = data.draw(st.integers(0, 255))
    at = data.draw(st.integers(1, len(cdr) // 4)) * 4
    if data.draw(st.booleans()) and at + 4 <= len(cdr):
        struct.pack_into("<I", cdr, at, data.draw(st.sampled_from([2**32 - 1, 2**31, 2**16, len(cdr)])))
    decode_or_refuse(name, bytes(cdr[: data.draw(st.integers(0, len(cdr)))]))


def decode_or_refuse(name: str, cdr: bytes) -> None:
    """Decoding returns a usable value or raises a ValueError."""
    try:
        value = jazzy().decode(name, cdr)
    except ValueError:
        return
    again = jazzy().encode(name, value)
    assert jazzy().encode(name, jazzy().decode(name, again)) == again


def test_parts_of_an_action_are_found_where_rclpy_has_them(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("nav2_msgs.action")
    parts = SimpleNamespace(SendGoalService=object(), FeedbackMessage=object())
    module.__dict__["NavigateToPose"] = SimpleNamespace(Impl=parts)
    monkeypatch.setitem(sys.modules, "nav2_msgs", ModuleType("nav2_msgs"))
    monkeypatch.setitem(sys.modules, "nav2_msgs.action", module)
    assert class_of("nav2_msgs/action/NavigateToPose_SendGoal") is parts.SendGoalService
    assert class_of("nav2_msgs/action/NavigateToPose_FeedbackMessage") is parts.FeedbackMessage
    for missing in ("nav2_msgs/action/NavigateToPose_GetResult", "nav2_msgs/action/Spin_SendGoal"):
        with pytest.raises(LookupError, match=missing):
            class_of(missing)
