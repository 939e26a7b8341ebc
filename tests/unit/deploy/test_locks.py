"""The locks name what pyproject.toml wants, by version and hash, and no address."""

import re
import tomllib

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

from tests.unit.deploy.stack import DEPLOY

ROOT = DEPLOY.parent
PARTS = {"ble", "discovery", "foxglove", "fusion", "mqtt", "plot", "ros2", "site", "web"}
LOCKS = {"ci": {"dev"}, "image": {"web", "site"}, "router": set[str]()}
"""The extras that each is for; `build` is for building."""
PIN = re.compile(r"^([\w.-]+)==(\S+)(?: ; .*)? \\$", re.MULTILINE)


def wanted(extras: set[str]) -> list[Requirement]:
    """Return the requirements of `extras` in pyproject.toml, without the package itself."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines = [*project["dependencies"]]
    for extra in extras:
        lines += project["optional-dependencies"][extra]
    found = [Requirement(line) for line in lines]
    inner = set[str]().union(*(each.extras for each in found if each.name == "pointit"))
    return wanted(extras | inner) if inner - extras else [each for each in found if each.name != "pointit"]


@pytest.mark.parametrize("name", [*LOCKS, "build", "lowest"])
def test_every_line_of_a_lock_is_a_version_with_hashes(name: str) -> None:
    text = (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8")
    assert "://" not in text
    rest = PIN.sub("", text)
    assert not re.sub(r"^    --hash=sha256:[0-9a-f]{64}(?: \\)?$", "", rest, flags=re.MULTILINE).strip()
    assert len(PIN.findall(text)) == len(re.findall(r"==.* \\\n    --hash=", text)) > 10


@pytest.mark.parametrize(("name", "extras"), LOCKS.items())
def test_a_lock_has_a_version_that_pyproject_takes(name: str, extras: set[str]) -> None:
    pins = PIN.findall((ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8"))
    for each in wanted(extras):
        versions = [version for package, version in pins if package == each.name.lower()]
        assert versions, f"{each.name} is missing in requirements/{name}.txt: run scripts/lock"
        assert all(each.specifier.contains(version) for version in versions), (
            f"requirements/{name}.txt: {each.name} {versions} is not {each.specifier}: run scripts/lock"
        )


def test_the_lowest_versions_are_those_that_pyproject_names() -> None:
    """If the exact version does not exist, as for mcap 1.2, another version of that series is accepted."""
    pins = PIN.findall((ROOT / "requirements" / "lowest.txt").read_text(encoding="utf-8"))
    for each in wanted(PARTS):
        (bound,) = (specifier.version for specifier in each.specifier if specifier.operator == ">=")
        (version,) = (version for package, version in pins if package == each.name.lower())
        assert Version(version).release[:2] == Version(f"{bound}.0").release[:2], (
            f"the lowest {each.name} is {bound}, but what is tested is {version}: run scripts/lock"
        )
