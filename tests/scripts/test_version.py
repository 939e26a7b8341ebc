"""One version in all places: packages, citation, documents, and the newest section of the changelog."""

import re
import subprocess
import tomllib
from collections.abc import Sequence
from pathlib import Path

import pytest
from packaging.version import Version

from tests.architecture.sources import ROOT
from tests.scripts.machine import PYTHON, Machine

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
VERSION = Version(PROJECT["version"])
PLACES = {"lab/pyproject.toml": r'^version = "(.+)"$', "CITATION.cff": r"^version: (.+)$"}
DATED = f"## [{VERSION}] - 2026-11-30"
GIT = """#!/bin/sh
case "$*" in
    *refs/tags/*) echo "$TAG"; test -n "$TAG" ;;
    "rev-parse HEAD") echo HEAD ;;
esac
"""
"""A checkout without changes; the tag of its version is at the commit `$TAG`."""
HEADING = re.compile(r"^## \[(.+?)\]", re.MULTILINE)

Completed = subprocess.CompletedProcess[str]


@pytest.mark.parametrize(("file", "pattern"), PLACES.items())
def test_places_have_the_version_of_the_project(file: str, pattern: str) -> None:
    text = (ROOT / file).read_text(encoding="utf-8")
    assert re.findall(pattern, text, re.MULTILINE) == [str(VERSION)]


def test_laboratory_needs_this_version_of_pointit() -> None:
    laboratory = tomllib.loads((ROOT / "lab/pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert f"pointit=={VERSION}" in laboratory["dependencies"]


def test_documents_name_wheels_of_this_version() -> None:
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "deploy").rglob("*.md")]
    named = {
        name
        for page in pages
        for name in re.findall(r"pointit(?:_lab)?-(\d[\w.]*)-py3", page.read_text(encoding="utf-8"))
    }
    assert named == {str(VERSION)}


def test_changelog_describes_the_version_first_or_its_development() -> None:
    headings = HEADING.findall((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    if headings[0] != "Unreleased":
        assert Version(headings[0]) == VERSION
        return
    assert VERSION.is_devrelease, "what is unreleased has a version such as 0.5.0.dev0"
    assert Version(headings[1]) < VERSION


def test_changelog_describes_each_version_once_and_newest_first() -> None:
    headings = HEADING.findall((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    versions = [Version(heading) for heading in headings if heading != "Unreleased"]
    assert versions == sorted(set(versions), reverse=True)


def release(folder: Path, headings: Sequence[str], *arguments: str, tag: str = "") -> Completed:
    """Run `scripts/release` on a changelog of sections `headings`; the version is tagged at commit `tag`."""
    machine = Machine(folder)
    machine.add("python3", PYTHON)
    machine.add("ls", "#!/bin/sh\n")
    machine.add("git", GIT)
    (machine.root / "CITATION.cff").write_text(f"version: {VERSION}\n")
    (machine.root / "CHANGELOG.md").write_text("\n\n".join(("# Changelog", *headings)) + "\n")
    return machine.run("release", *arguments, str(folder / "release"), TAG=tag)


@pytest.mark.parametrize(
    "heading", ["## [Unreleased]", f"## [{VERSION}]", "## [99.0.0] - 2026-01-01", "## [0.0.1] - 2020-01-01"]
)
def test_release_is_refused_unless_the_changelog_begins_with_it(heading: str, tmp_path: Path) -> None:
    done = release(tmp_path, [heading])
    assert done.returncode == 1
    assert f"CHANGELOG.md begins with '{heading}', not with '## [{VERSION}] - DATE'" in done.stderr


@pytest.mark.parametrize("arguments", [(), ("--dry-run",)], ids=["release", "dry run"])
@pytest.mark.parametrize("heading", ["## [Unreleased]", "## [99.0.0] - 2026-01-01", DATED])
def test_release_is_refused_when_an_older_section_describes_it(
    heading: str, arguments: Sequence[str], tmp_path: Path
) -> None:
    done = release(tmp_path, [heading, DATED], *arguments, tag="HEAD")
    assert done.returncode == 1
    assert f"CHANGELOG.md already describes {VERSION}, below what is newer" in done.stderr


@pytest.mark.parametrize(
    ("tag", "refusal"), [("", "this commit has not the tag"), ("other", "another commit has the tag")]
)
def test_release_is_refused_unless_its_tag_is_here(tag: str, refusal: str, tmp_path: Path) -> None:
    done = release(tmp_path, [DATED], tag=tag)
    assert done.returncode == 1
    assert f"{refusal} v{VERSION}" in done.stderr
