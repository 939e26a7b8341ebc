"""A plug-in that is not installed: the message names what is, and the package that has the name."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from pointit.plugins import GROUPS
from pointit.runtime.config import installed
from pointit.runtime.errors import ConfigError
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.led_driver.outputs import validate_output
from pointit.services.robot.config import RobotConfig
from pointit.services.selector.config import SelectorConfig
from tests.support import strangers


def test_driver_that_no_package_has_is_refused_with_the_group_of_its_entry_point() -> None:
    sentence = (
        "use one of ros2, sim, vda5050; another one comes from a package with an entry point 'turtle' of "
        "pointit.robots, or is in pyproject.toml: then run scripts/setup"
    )
    with pytest.raises(ValidationError, match=sentence):
        RobotConfig(driver="turtle")
    with pytest.raises(ConfigError, match=r"no robot driver .turtle. is installed; there are ros2, sim, "):
        GROUPS["robot"].get("turtle")


def test_installed_wheel_names_no_script_of_a_checkout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(installed, "_SETUP", tmp_path / "setup")
    with pytest.raises(ValidationError, match=r"entry point 'turtle' of pointit.robots \["):
        RobotConfig(driver="turtle")


def test_plug_in_of_another_kind_is_named_with_its_package(tmp_path: Path) -> None:
    with strangers.installed(tmp_path, "strangers_kinds", "", robots="rover = strangers_kinds:ROVER"):
        clause = "; 'rover' of strangers-parts is of another kind, pointit.robots"
        with pytest.raises(ValidationError, match=clause):
            ImuBridgeConfig(source="rover")
        with pytest.raises(ValidationError, match=clause):
            SelectorConfig(method="rover")
        with pytest.raises(ValueError, match=f"use one of none, adalight, .*{clause}"):
            validate_output({"kind": "rover"})
