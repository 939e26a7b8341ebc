"""The plan editor's server: the map in use is read, checked with edits, saved in place or as a copy."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import pytest

from pointit.bridges.web.model.map_editor import MapEditor
from pointit.maps.edit.edits import Add, Edit, SetValue
from pointit.maps.file import load_map
from pointit.runtime.bus.contract import Bus
from pointit.runtime.errors import PointItError, RefusedError
from pointit.schemas import KeyNameError, UseMap, UseMapReply

ROOM = """\
# my room
lamps:
  door: {position: [0, 1, 2]}
  desk: {position: [3, 1, 1]}   # beside the screen
strips:
  top: {line: [[0, 0, 1], [1, 0, 1]], pixels: 60, length: 1.0}
"""
HIGHER = SetValue(section="lamps", name="desk", key="position", value=[3, 1, 1.25])


class Site:
    """A site whose `pui` uses `map`, or refuses to change it with the sentence `refuses`."""

    def __init__(self, used: str) -> None:
        self.map = used
        self.refuses = ""
        self.editor = MapEditor(cast("Bus", self))

    async def call(self, _request: object, query: UseMap) -> UseMapReply:
        if query.map and self.refuses:
            raise RefusedError(self.refuses)
        self.map = query.map or self.map
        return UseMapReply(map=self.map)

    def read(self) -> dict[str, Any]:
        return asyncio.run(self.editor.read())

    def check(self, edits: Sequence[Edit], digest: str) -> dict[str, Any]:
        return asyncio.run(self.editor.check(edits, digest))

    def save(self, edits: Sequence[Edit], digest: str, name: str) -> dict[str, Any]:
        return asyncio.run(self.editor.save(edits, digest, name))


@pytest.fixture
def site(tmp_path: Path) -> Site:
    path = tmp_path / "room.yaml"
    path.write_text(ROOM)
    return Site(str(path))


def test_the_map_in_use_is_read_in_the_words_of_its_file(site: Site) -> None:
    found = site.read()
    assert (found["path"], found["shipped"], found["findings"]) == (site.map, False, [])
    assert found["sections"]["strips"] == {
        "top": {"line": [[0, 0, 1], [1, 0, 1]], "pixels": 60, "length": 1.0}
    }


def test_findings_are_those_on_the_edited_map_and_the_file_stays(site: Site) -> None:
    digest = site.read()["digest"]
    below = SetValue(section="lamps", name="desk", key="position", value=[3, 1, -1])
    none = SetValue(section="strips", name="top", key="pixels", value=0)
    cases: tuple[tuple[list[Edit], tuple[str, str, str]], ...] = (
        ([below], ("error", "lamps.desk", "below the floor")),
        ([below, none], ("error", "strips.top.pixels", "write")),
    )
    for edits, (severity, where, text) in cases:
        (found,) = site.check(edits, digest)["findings"]
        assert (found["severity"], found["where"]) == (severity, where)
        assert text in found["text"]
    assert Path(site.map).read_text() == ROOM


def test_a_saved_map_has_its_comments_and_mode_and_is_used_at_once(site: Site) -> None:
    path = Path(site.map)
    path.chmod(0o640)
    digest = site.read()["digest"]
    saved = site.save([HIGHER], digest, "")
    assert path.read_text() == ROOM.replace("[3, 1, 1]", "[3, 1, 1.25]")
    assert path.stat().st_mode & 0o777 == 0o640
    assert saved["message"] == f"saved to {path}, and people point at it"
    site.save([], saved["digest"], "")  # what was saved is what is edited next


def test_a_file_that_somebody_else_changed_is_not_overwritten(site: Site) -> None:
    digest = site.read()["digest"]
    Path(site.map).write_text(theirs := ROOM + "# theirs\n")
    with pytest.raises(RefusedError, match="was changed by somebody else since"):
        site.check([HIGHER], digest)
    with pytest.raises(RefusedError, match="was changed by somebody else since"):
        site.save([HIGHER], digest, "")
    assert Path(site.map).read_text() == theirs


def test_a_shipped_map_is_saved_as_a_copy_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    site = Site("lab")
    found = site.read()
    assert found["shipped"] is True
    edit = Add(section="lamps", name="new", value={"position": [0, 0, 1]})
    with pytest.raises(RefusedError, match="lab comes with PointIt and stays as it is"):
        site.save([edit], found["digest"], "")
    saved = site.save([edit], found["digest"], "mine")
    assert site.map == saved["path"] == str(tmp_path / "mine.yaml")
    assert saved["message"].endswith(f"with --set pui.map={site.map}")
    assert [lamp.id for lamp in load_map(site.map, 0).lamps][-1] == "new"


@pytest.mark.parametrize(
    ("name", "error", "sentence"),
    [
        ("other", RefusedError, "is there already; choose another name"),
        ("../other", KeyNameError, "other"),
        ("", RefusedError, "not saved: strips.top.pixels: write"),
    ],
)
def test_what_cannot_be_saved_changes_no_file(
    site: Site, tmp_path: Path, name: str, error: type[Exception], sentence: str
) -> None:
    (tmp_path / "other.yaml").write_text("theirs")
    edits: list[Edit] = [HIGHER] if name else [SetValue(section="strips", name="top", key="pixels", value=0)]
    with pytest.raises(error, match=sentence):
        site.save(edits, site.read()["digest"], name)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {
        "room.yaml": ROOM,
        "other.yaml": "theirs",
    }


def test_that_the_site_does_not_take_a_saved_map_is_said(site: Site) -> None:
    digest = site.read()["digest"]
    site.refuses = "nothing to point at"
    saved = site.save([HIGHER], digest, "")
    assert saved["message"].endswith("but the site still uses the map as it was: nothing to point at")


def test_a_map_on_another_machine_is_not_edited_here() -> None:
    with pytest.raises(PointItError, match="not on the machine of this page; open a page where `pui` runs"):
        Site("/no/such/room.yaml").read()
