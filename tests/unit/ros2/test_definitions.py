"""Definitions of ROS types: hashes as a running ROS 2 has them, packages for colcon, CDR of any value."""

import re
import struct
import sys
from importlib.resources import files
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Literal
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.graph.backend import Distro
from pointit.bridges.ros2.over_rclpy.rclpy_library import class_of
from pointit.bridges.ros2.types.definitions import INTERFACES, NAVIGATE_TO_POSE, Definitions, Rihs01, actions
from pointit.bridges.ros2.types.types import Types
from pointit.runtime.errors import ConfigError
from tests.unit.ros2.scenes import jazzy
from tests.unit.ros2.values import any_value, definitions, golden, plain


def computed(hashes: Rihs01, name: str) -> str:
    """Our description of a message, a service, or one of a service's halves or events."""
    if "/srv/" not in name or name.endswith(("_Request", "_Response")):
        return hashes.message(name)
    service = name.partition("_Event")[0]
    of_service = hashes.service(service)
    return of_service if service == name else hashes.message(name)


@pytest.mark.parametrize(("distro", "count"), [("jazzy", 296), ("kilted", 269)])
def test_every_known_hash_is_computed(distro: Literal["jazzy", "kilted"], count: int) -> None:
    extra, store = definitions(), Definitions(distro).store
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
def test_what_is_built_is_what_is_there(package: str) -> None:
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
