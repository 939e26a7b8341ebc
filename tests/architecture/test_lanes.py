"""`.ci/lanes.py`: what has changed chooses the tests, and a lane has all tests of its room."""

import importlib.util
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import pytest

from tests.architecture.sources import ROOT, importers, shown
from tests.support import there

SCRIPT = ROOT / ".ci/lanes.py"


@pytest.fixture(scope="module")
def lanes() -> ModuleType:
    spec = importlib.util.spec_from_file_location("lanes", SCRIPT)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    there(spec.loader).exec_module(module)
    return module


@pytest.mark.parametrize(
    ("changed", "why", "runs", "leaves"),
    [
        (["lab/pointit_lab/cli/x.py"], "lab", "tests/lab", "tests/unit/imu_bridge"),
        (["lab/pointit_lab/devices/ble.py"], "devices", "tests/unit/imu_bridge", "tests/lab"),
        (["tests/lab/cli/test_x.py", "CHANGELOG.md"], "lab", "tests/docs", "tests/unit/web"),
        (["bridges/web/page.py"], "page", "tests/e2e/web", "tests/unit/ros2"),
        (["services/robot/a.py", "services/goal/b.py"], "robots",
         "tests/unit/goal", "tests/lab"),
        (["bridges/ros2/a/b.py"], "ros2", "tests/interop/ros2_dds", "tests/unit/web"),
        (["docs/how-to/run.md", "README.md"], "documents", "tests/docs", "tests/golden"),
    ],
)  # fmt: skip
def test_a_room_runs_a_lane(lanes: ModuleType, changed: list[str], why: str, runs: str, leaves: str) -> None:
    told, tests = lanes.lane(changed)
    assert told.startswith(f"{why}: ")
    assert runs in tests
    assert leaves not in tests
    assert "tests/architecture" in tests
    assert why == "documents" or set(lanes.ALWAYS) <= set(tests)


@pytest.mark.parametrize(
    "changed",
    [
        [],
        ["services/selector/service.py"],
        ["pyproject.toml"],
        ["tests/support/pace.py", "lab/pointit_lab/cli/a.py"],
        ["lab/pointit_lab/cli/a.py", "bridges/web/page.py"],
        ["laboratory/a.py"],
        ["docs/index.md", "pointit/geometry/vector.py"],
    ],
    ids=" ".join,
)
def test_any_other_change_runs_everything(lanes: ModuleType, changed: list[str]) -> None:
    told, tests = lanes.lane(changed)
    assert told.startswith("everything: ")
    assert tests == ()


def test_everything_runs_again_after_ten_commits(lanes: ModuleType) -> None:
    assert [now for now in range(101, 125) if lanes.is_turn_of_all(now - 1, now)] == [110, 120]
    assert lanes.is_turn_of_all(101, 115)
    assert not lanes.is_turn_of_all(101, 109)


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """Return a clone whose origin has 3 commits."""
    origin = tmp_path / "origin"
    (origin / ".ci").mkdir(parents=True)
    shutil.copy(SCRIPT, origin / ".ci")
    git(origin, "init", "--quiet", "--initial-branch", "main")
    for _ in range(3):
        commit(origin, "services/a.py")
    git(tmp_path, "clone", "--quiet", str(origin), "clone")
    return tmp_path / "clone"


def git(folder: Path, *arguments: str) -> None:
    identity = ("-c", "user.name=a", "-c", "user.email=a@localhost")
    subprocess.run(["git", *identity, *arguments], cwd=folder, check=True)  # noqa: S607 - any git


def commit(folder: Path, *names: str) -> None:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{path.read_text() if path.exists() else ''}1\n")
    git(folder, "add", "--all")
    git(folder, "commit", "--quiet", "--message", "a")


def run(lanes: ModuleType, monkeypatch: pytest.MonkeyPatch, folder: Path, base: str = "") -> Sequence[str]:
    monkeypatch.setattr(lanes, "ROOT", folder)
    monkeypatch.setenv("CI_BASE", base)
    told, tests = lanes.chosen()
    return (told.partition(":")[0], *tests)


def test_changes_since_what_landed(lanes: ModuleType, monkeypatch: pytest.MonkeyPatch, clone: Path) -> None:
    assert run(lanes, monkeypatch, clone) == ("everything",)
    commit(clone, "lab/pointit_lab/cli/a.py", "tests/lab/cli/test_a.py")
    assert run(lanes, monkeypatch, clone) == ("lab", "tests/lab")
    commit(clone, "lab/pointit_lab/cli/b.py")
    assert run(lanes, monkeypatch, clone, "HEAD^") == ("lab", "tests/lab")
    assert run(lanes, monkeypatch, clone, "nonsense") == ("everything",)
    (clone / "new.py").write_text("")
    assert run(lanes, monkeypatch, clone) == ("everything",)
    (clone / "new.py").unlink()
    git(clone, "mv", "services/a.py", "lab/pointit_lab/cli/c.py")
    assert run(lanes, monkeypatch, clone) == ("everything",)  # moved out of another room
    git(clone, "reset", "--quiet", "--hard")
    for _ in range(5):
        commit(clone, "lab/pointit_lab/cli/b.py")
    assert run(lanes, monkeypatch, clone) == ("everything",)  # the tenth commit


def test_of_a_clone_without_history_or_origin_everything_runs(
    lanes: ModuleType, monkeypatch: pytest.MonkeyPatch, clone: Path, tmp_path: Path
) -> None:
    commit(clone, "lab/pointit_lab/cli/a.py")
    git(tmp_path, "clone", "--quiet", "--depth", "1", f"file://{clone}", "shallow")
    assert run(lanes, monkeypatch, tmp_path / "shallow", "HEAD") == ("everything",)
    git(clone, "remote", "remove", "origin")
    assert run(lanes, monkeypatch, clone) == ("everything",)
    shutil.rmtree(clone / ".git")
    assert run(lanes, monkeypatch, clone) == ("everything",)


@pytest.mark.parametrize("page", ["how-to/adding.md", "how-to/contribute.md"])
def test_every_lane_is_named_where_people_read_of_them(lanes: ModuleType, page: str) -> None:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    paragraph = next(each for each in text.split("\n\n") if "lane" in each and "`foxglove`" in each)
    assert [name for name in lanes.ROOMS if f"`{name}`" not in paragraph] == []


def test_every_place_of_a_lane_is_there(lanes: ModuleType) -> None:
    places = {*lanes.ALWAYS, *lanes.DOCUMENTS, *lanes.OF_DOCUMENTS}
    for room in lanes.ROOMS.values():
        places.update(room.sources, room.tests, room.others)
    assert not [each for each in sorted(places) if not (ROOT / each).exists()]


def test_a_lane_has_every_test_that_imports_its_room(lanes: ModuleType) -> None:
    """Tests that only name the room in a command are among those of whole runs."""
    files = tuple(sorted((ROOT / "tests").rglob("*.py")))
    for name, room in lanes.ROOMS.items():
        paths = [each.removeprefix("lab/") for each in room.sources]
        modules = [re.sub(r"^\w+/(?=pointit)", "", each).replace("/", ".") for each in paths]
        runs = (*room.tests, *room.others, *lanes.ALWAYS, "tests/support")
        left_out = {
            place
            for module in modules
            for place in importers(module, files)
            if not lanes.is_in(place.partition(":")[0], runs)
        }
        assert not left_out, f".ci/lanes.py: the lane {name} needs them"


READS_PAGES = re.compile(r"""["/]docs["/]|README\.md|CHANGELOG\.md""")


def test_the_lane_of_documents_has_every_test_that_reads_pages(lanes: ModuleType) -> None:
    read = [
        path for path in sorted((ROOT / "tests").rglob("test_*.py")) if READS_PAGES.search(path.read_text())
    ]
    assert not [shown(path) for path in read if not lanes.is_in(shown(path), lanes.OF_DOCUMENTS)]
