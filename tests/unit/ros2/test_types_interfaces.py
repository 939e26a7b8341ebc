"""The packages that a ROS user builds with colcon."""

import re
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from pointit.bridges.ros2.types import definitions
from pointit.bridges.ros2.types.definitions import INTERFACES, Definitions
from pointit.runtime.errors import ConfigError

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
    monkeypatch.setattr(definitions, "INTERFACES", tmp_path)
    with pytest.raises(ConfigError, match=r"a_msgs/msg/A in .*: is not a definition of a ROS type"):
        Definitions("jazzy")
