"""Files of the documents are read by what they are for, also on pages of which no command runs.

`tests/docs/test_pages.py` runs commands, and only parses files. A file that is neither a map, a scenario nor
parameters of services has its reason in `READ_ELSEWHERE`.
"""

import re
from pathlib import Path

import pytest
import yaml

from pointit.launch.plan.launches import Choices
from pointit.launch.plan.plan import read_scenario
from pointit.launch.plan.scenario_catalog import scenario_launches
from pointit.maps.checks.check import examined
from pointit.maps.file import parse_map_file
from pointit.services import registry
from tests.docs.blocks import Block
from tests.docs.test_pages import PAGES

FILES = {
    f"{page}:{block.title}": block
    for page, found in PAGES.items()
    for block in found
    if block.language == "yaml" and block.title
}
MAP_KEYS = {"lamps", "strips", "belts", "things"}
READ_ELSEWHERE = {
    "docs/how-to/ros2.md:routes.yaml": "the page's command runs it as parameters of one service",
    "docs/how-to/run.md:my_site.yaml": "the page's command runs it by `--on`",
    "docs/how-to/study.md:my_study.yaml": "the page's command runs it as a study",
}
"""Reasons by page and file."""


def scenario_for(services: set[str]) -> str:
    """Return the shipped scenario that starts `services`."""
    return "scenario_6" if "robot" in services else "scenario_3"


def check_parameters(path: Path, keys: list[str]) -> None:
    """Check the parameters of services in the file at `path`, whose top level has `keys`."""
    services = {key.partition(".")[0].replace("_", "-") for key in keys}
    assert services <= set(registry.names()), f"no service {services - set(registry.names())}"
    choices = Choices(
        files=[path],
        ros2="ros2" in services,
        services=[name for name in services if name == "home-assistant"],
    )
    launches = scenario_launches(read_scenario(scenario_for(services)), choices, 1)
    assert services <= {launch.service.NAME for launch in launches}


@pytest.mark.parametrize("name", sorted(FILES.keys() - READ_ELSEWHERE.keys()))
def test_file_of_a_page_is_read(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    block = FILES[name]
    _save_page(block, tmp_path)
    monkeypatch.chdir(tmp_path)
    path = tmp_path / block.title
    keys = list(yaml.safe_load(block.code))

    if "about" in keys:
        assert scenario_launches(read_scenario(block.title), Choices(), 1)
    elif MAP_KEYS & {*keys}:
        _, findings = examined(name, path, lambda: parse_map_file(block.code.encode(), path))
        assert not [finding for finding in findings if finding.severity == "error"]
    else:
        check_parameters(path, keys)


def _save_page(block: Block, folder: Path) -> None:
    """Save the files of the page of `block` in `folder`, its own last: some have one name."""
    page = next(page for page, found in PAGES.items() if block in found)
    for other in [*PAGES[page], block]:
        if other.title and re.fullmatch(r"[\w.-]+", other.title):
            (folder / other.title).write_text(other.code, encoding="utf-8")


def test_files_that_are_read_elsewhere_exist() -> None:
    assert READ_ELSEWHERE.keys() <= FILES.keys()
