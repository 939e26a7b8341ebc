"""The plan editor's server: the map in use is read, checked with edits, saved in place or as a copy."""

from collections.abc import Awaitable
from pathlib import Path
from typing import cast

import pytest

from pointit.bridges.web.model.map_editor import MapEditor
from pointit.bridges.web.model.site_model import shown_path, with_shown_path
from pointit.maps.edit import Add, Edit, SetValue, StaleMapError
from pointit.maps.file import load_map
from pointit.runtime.bus.contract import Bus
from pointit.runtime.errors import PointItError, RefusedError
from pointit.schemas import UseMap, UseMapReply

pytestmark = pytest.mark.wall_time  # files are read in threads

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
        if query.path and self.refuses:
            raise RefusedError(self.refuses)
        self.map = query.path or self.map
        return UseMapReply(path=self.map)


async def refused(request: Awaitable[object]) -> str:
    """Return the reason."""
    with pytest.raises(RefusedError) as error:
        await request
    return str(error.value)


def text_of(path: str) -> str:
    return Path(path).read_text()


def texts_in(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir()}


def mode_of(path: str) -> int:
    return Path(path).stat().st_mode & 0o777


def put(path: str, text: str, mode: int = 0o644) -> str:
    Path(path).write_text(text)
    Path(path).chmod(mode)
    return text


@pytest.fixture
def site(tmp_path: Path) -> Site:
    path = tmp_path / "room.yaml"
    path.write_text(ROOM)
    return Site(str(path))


async def test_map_in_use_is_read_as_its_file_writes_it(site: Site) -> None:
    found = await site.editor.read()
    assert (found["path"], found["shipped"], found["findings"]) == (site.map, False, [])
    assert found["sections"]["strips"] == {
        "top": {"line": [[0, 0, 1], [1, 0, 1]], "pixels": 60, "length": 1.0}
    }


async def test_check_reports_findings_on_edits_and_keeps_the_file(site: Site) -> None:
    digest = (await site.editor.read())["digest"]
    below = SetValue(section="lamps", name="desk", key="position", value=[3, 1, -1])
    none = SetValue(section="strips", name="top", key="pixels", value=0)
    cases: tuple[tuple[list[Edit], tuple[str, str, str]], ...] = (
        ([below], ("error", "lamps.desk", "below the floor")),
        ([below, none], ("error", "strips.top.pixels", "write")),
    )
    for edits, (severity, where, text) in cases:
        (found,) = (await site.editor.check(edits, digest))["findings"]
        assert (found["severity"], found["where"]) == (severity, where)
        assert text in found["text"]
    assert text_of(site.map) == ROOM


async def test_saved_map_keeps_comments_and_mode_and_is_used(site: Site) -> None:
    put(site.map, ROOM, mode=0o640)
    digest = (await site.editor.read())["digest"]
    saved = await site.editor.save([HIGHER], digest, "")
    assert text_of(site.map) == ROOM.replace("[3, 1, 1]", "[3, 1, 1.25]")
    assert mode_of(site.map) == 0o640
    name = f"…/{Path(site.map).parent.name}/room.yaml"
    assert saved["message"] == f"saved as {name}, and people point at it"
    await site.editor.save([], saved["digest"], "")  # what was saved is what is edited next


async def test_map_behind_a_link_is_saved_at_its_target(site: Site, tmp_path: Path) -> None:
    link = tmp_path / "link.yaml"
    link.symlink_to(site.map)
    there = site.map
    site.map = str(link)
    digest = (await site.editor.read())["digest"]
    await site.editor.save([HIGHER], digest, "")
    assert link.is_symlink()
    assert "[3, 1, 1.25]" in text_of(there)


async def test_file_is_not_overwritten_when_another_user_changed_it(site: Site) -> None:
    digest = (await site.editor.read())["digest"]
    theirs = put(site.map, ROOM + "# theirs\n")
    with pytest.raises(StaleMapError, match="was changed by somebody else since"):
        await site.editor.check([HIGHER], digest)
    with pytest.raises(StaleMapError, match="was changed by somebody else since"):
        await site.editor.save([HIGHER], digest, "")
    assert text_of(site.map) == theirs


async def test_shipped_map_is_saved_only_as_a_copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    site = Site("lab")
    found = await site.editor.read()
    assert found["shipped"] is True
    edit = Add(section="lamps", name="new", value={"position": [0, 0, 1]})
    with pytest.raises(RefusedError, match="lab comes with PointIt and stays as it is"):
        await site.editor.save([edit], found["digest"], "")
    saved = await site.editor.save([edit], found["digest"], "mine")
    assert site.map == saved["path"] == str(tmp_path / "mine.yaml")
    assert saved["message"] == (
        "saved as mine.yaml, and people point at it; from the next start on with --set pui.map=mine.yaml"
    )
    assert [lamp.id for lamp in load_map(site.map, 0).lamps][-1] == "new"


@pytest.mark.parametrize(
    ("name", "error", "sentence"),
    [
        ("other", RefusedError, "/other.yaml: exists already; choose another name"),
        ("../other", RefusedError, "other"),
        ("", RefusedError, "not saved: strips.top.pixels: write"),
    ],
)
async def test_refused_save_changes_no_file(
    site: Site, tmp_path: Path, name: str, error: type[Exception], sentence: str
) -> None:
    put(str(tmp_path / "other.yaml"), "theirs")
    edits: list[Edit] = [HIGHER] if name else [SetValue(section="strips", name="top", key="pixels", value=0)]
    with pytest.raises(error, match=sentence):
        await site.editor.save(edits, (await site.editor.read())["digest"], name)
    assert texts_in(tmp_path) == {"room.yaml": ROOM, "other.yaml": "theirs"}


async def test_reply_says_when_the_site_refuses_a_saved_map(site: Site) -> None:
    digest = (await site.editor.read())["digest"]
    site.refuses = f"{site.map}: nothing to point at"
    saved = await site.editor.save([HIGHER], digest, "")
    assert saved["message"].endswith("/room.yaml: nothing to point at")
    assert "but the site still uses the map as it was" in saved["message"]
    assert str(Path(site.map).parent) not in saved["message"]


async def test_message_on_a_copy_elsewhere_has_no_full_path(site: Site) -> None:
    saved = await site.editor.save([HIGHER], (await site.editor.read())["digest"], "mine")
    assert saved["message"].endswith("from the next start on with the path of mine.yaml in --set pui.map")
    assert Path(site.map).name == "mine.yaml"


async def test_editor_messages_never_have_the_folder_of_the_map(site: Site, tmp_path: Path) -> None:
    digest = (await site.editor.read())["digest"]
    put(str(tmp_path / "other.yaml"), "theirs")
    invalid: list[Edit] = [SetValue(section="lamps", name="none", key="position", value=[0, 0, 1])]
    sentences = [
        await refused(site.editor.check([HIGHER], "another digest")),
        await refused(site.editor.save([HIGHER], digest, "other")),
        await refused(site.editor.check(invalid, digest)),
    ]
    put(site.map, "lamps: [")
    sentences.append(await refused(site.editor.read()))
    site.map = str(tmp_path / "gone.yaml")
    sentences.append(await refused(site.editor.read()))
    assert [each for each in sentences if str(tmp_path) in each] == []
    assert all("room.yaml" in each for each in (sentences[0], sentences[3]))


@pytest.mark.parametrize(
    ("path", "shown"),
    [
        ("start/mine.yaml", "mine.yaml"),
        ("start/maps/mine.yaml", "maps/mine.yaml"),
        ("srv/maps/mine.yaml", "…/maps/mine.yaml"),
    ],
)
def test_path_is_shown_relative_to_the_start_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: str, shown: str
) -> None:
    (tmp_path / "start").mkdir()
    monkeypatch.chdir(tmp_path / "start")
    there = tmp_path / path
    assert shown_path(there) == shown
    sentence = f"{there}: cut; see {there.with_name('b.yaml')}"
    assert with_shown_path(sentence, there) == f"{shown}: cut; see {shown.replace('mine', 'b')}"


async def test_map_on_another_machine_cannot_be_edited() -> None:
    with pytest.raises(PointItError, match="not on the machine of this page; open a page where `pui` runs"):
        await Site("/no/such/room.yaml").editor.read()
