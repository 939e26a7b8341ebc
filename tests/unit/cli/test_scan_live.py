"""`pointit map scan`: the site that it starts, and what it refuses. Whole scans: `tests/e2e/web`."""

import math
from pathlib import Path
from typing import Any

import pytest

from pointit.cli.main import command
from pointit.cli.run.run import run
from pointit.maps.file import load_map
from pointit.runtime.config.yaml_file import parse_yaml
from pointit.runtime.errors import ConfigError
from pointit.schemas import Environment
from tests.support import there
from tests.support.invoked import printed


class Started:
    """Arguments of `pointit run`."""

    def __init__(self) -> None:
        self.arguments: list[str] = []
        self.map: Environment | None = None

    def run(self, arguments: list[str], **_options: Any) -> int:
        self.arguments = arguments
        self.map = load_map(self.setting("pui.map"), 0)
        assert Path(arguments[0]).is_file()
        return 0

    def setting(self, name: str) -> str:
        (found,) = [each for each in self.arguments if each.startswith(f"--set={name}=")]
        value = parse_yaml(f"value: {found.split('=', 2)[2]}".encode(), "--set")["value"]
        assert isinstance(value, str), f"{found}: `pointit run` wants text"
        return value

    @property
    def strips(self) -> dict[str, int]:
        return {strip.id: strip.pixels for strip in there(self.map).strips}


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Started:
    monkeypatch.chdir(tmp_path)
    started = Started()
    monkeypatch.setattr(run, "main", started.run)
    return started


def scan(*arguments: str) -> None:
    printed(command, "map", "scan", *arguments)


def test_a_site_with_the_named_strips_is_open_to_phones(started: Started, tmp_path: Path) -> None:
    strips = "--strip shelf=90 --strip desk=60 --leds-per-m 30"
    scan(*f"-o hall.yaml {strips} --leds ddp:10.0.0.9 -- --no-browser".split())
    assert started.strips == {"shelf": 90, "desk": 60}
    assert [math.dist(*strip.line_m) for strip in there(started.map).strips] == [3.0, 2.0]
    assert {"--lan", "--site-only", "--no-browser", "--output=ddp:10.0.0.9"} <= set(started.arguments)
    assert started.setting("web.scan_file") == str(tmp_path / "hall.yaml")
    assert len(started.setting("web.scan_token")) >= 24
    assert started.setting("web.scan_room") == ""
    assert not Path(started.arguments[0]).exists(), "it is removed afterwards"


def test_strips_of_a_map_count_wherever_they_are_in_it(started: Started) -> None:
    scan("--map", "lab", "--strip", "extra=10", "--lamp", "bulb")
    assert started.strips["extra"] == 10
    lamps = [lamp.id for lamp in there(started.map).lamps]
    assert lamps == [*(lamp.id for lamp in load_map("lab", 0).lamps), "bulb"]
    assert len(started.strips) == 1 + len(load_map("lab", 0).strips)


def test_a_simulated_room_is_open_to_this_machine_only(started: Started) -> None:
    scan("--simulated")
    assert len(started.strips) == 5
    assert started.setting("web.scan_room").endswith("simulated_room.yaml")
    assert "--lan" not in started.arguments


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((), "no strips are given: add --strip NAME=PIXELS"),
        (("--simulated", "--all"), "--known and --all need --from"),
        (("--strip", "shelf"), "--strip shelf: write NAME=PIXELS, such as shelf=90"),
        (("--strip", "shelf=1"), "with 2 to 4096 pixels"),
        (("--strip", "a b=10"), "write NAME=PIXELS"),
        (("--simulated", "-o", "there.yaml"), "there.yaml: exists already; choose another name"),
        (("--simulated", "-o", "no/where.yaml"), "no/where.yaml: there is no folder no"),
    ],
)
def test_wrong_options_of_a_scan_are_reported_before_the_start(
    started: Started, arguments: tuple[str, ...], sentence: str
) -> None:
    Path("there.yaml").write_text("mine")
    with pytest.raises(ConfigError) as refused:
        scan(*arguments)
    assert sentence in str(refused.value)
    assert started.arguments == []
    assert Path("there.yaml").read_text() == "mine"
