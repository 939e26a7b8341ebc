"""A file that is no scenario, or not there, is told with what to do."""

from pathlib import Path

import pytest

from pointit.launch.plan.scenario import read_scenario
from pointit.runtime.errors import ConfigError


def test_a_room_is_no_scenario_and_the_sentence_says_how_to_run_one_in_it(tmp_path: Path) -> None:
    path = tmp_path / "my_room.yaml"
    path.write_text("leds:\n  led_0:\n    position: [3, 1, 2]\n", encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        read_scenario(str(path))
    assert str(caught.value).startswith(f"{path}: is a map, not a scenario; ")
    assert f"`pointit run scenario_2 --set pui.map={path}`" in str(caught.value)


def test_a_scenario_file_that_is_not_there_is_said_with_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.yaml: cannot be read \(No such file.*\); check its path"):
        read_scenario(str(tmp_path / "none.yaml"))
