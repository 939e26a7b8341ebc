"""One version in all places: packages, citation, documents, and the newest section of the changelog."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.version import Version

from tests.architecture.sources import ROOT
from tests.scripts.machine import PYTHON, Machine

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
VERSION = Version(PROJECT["version"])
PLACES = {"lab/pyproject.toml": r'^version = "(.+)"$', "CITATION.cff": r"^version: (.+)$"}
HEADING = re.compile(r"^## \[(.+?)\]", re.MULTILINE)


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


@pytest.mark.parametrize(
    "heading", ["## [Unreleased]", f"## [{VERSION}]", "## [99.0.0] - 2026-01-01", "## [0.0.1] - 2020-01-01"]
)
def test_release_is_refused_unless_the_changelog_begins_with_it(heading: str, tmp_path: Path) -> None:
    machine = Machine(tmp_path)
    machine.add("python3", PYTHON)
    machine.add("ls", "#!/bin/sh\n")
    (machine.root / "CITATION.cff").write_text(f"version: {VERSION}\n")
    (machine.root / "CHANGELOG.md").write_text(f"# Changelog\n\n{heading}\n\n## [{VERSION}] - 2020-01-01\n")
    done = machine.run("release", str(tmp_path / "release"))
    assert done.returncode == 1
    assert f"CHANGELOG.md begins with '{heading}', not with '## [{VERSION}] - DATE'" in done.stderr
