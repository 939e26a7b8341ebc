"""The rules of the house that no type checker sees: rooms, tables, keys, doors."""

import ast
import re
import shutil
import subprocess
import zipfile
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

import pointit
from pointit.runtime.config.config import Config
from pointit.runtime.service.service import Service
from pointit.schemas.topics import PRESENCES, REQUESTS, TOPICS, Topic
from pointit.services.registry import PROCESSES, Process
from tests.architecture import sources
from tests.architecture.sources import ROOT, shown
from tests.support.invoked import python

HOMES = {"services": ROOT / "services", "bridges": ROOT / "bridges"}
"""Folders of processes, by room."""
OUTSIDERS = {"cli", "external", "every service"}
"""Writers that are no row of the process table."""
HARMLESS = (
    *("pointit.runtime.config", "pointit.runtime.errors", "pointit.runtime.bus.timeliness"),
    *("pointit.runtime.address_config", "pointit.runtime.host.extras"),
    *("pointit.runtime.host.advised_commands",),
    *("pointit.runtime.host.state_file", "pointit.runtime.host.store", "pointit.runtime.host.unpacking"),
    *("pointit.runtime.link", "pointit.runtime.mqtt.broker_config", "pointit.runtime.mqtt.discovery"),
)
"""Parts of the runtime that cores may import: they know no bus, no clock and no loop."""
LONGEST = 600
NAMES = {row.name for row in PROCESSES}
rows = pytest.mark.parametrize("row", [pytest.param(row, id=row.name) for row in PROCESSES])
topics = pytest.mark.parametrize("topic", [pytest.param(topic, id=topic.key) for topic in TOPICS])


def test_the_package_links_to_the_rooms_beside_it() -> None:
    assert [Path(path) for path in pointit.__path__] == [ROOT / "pointit"]
    for name in sources.LINKS:
        assert (ROOT / "pointit" / name).readlink() == Path("..", name)
        done = python("-c", f"import {name}")
        assert f"this is `pointit.{name}`" in done.stderr, "one module under two names"


GIT_REMEDY = "`git config core.symlinks true`, then `git checkout -- pointit`"


@pytest.mark.parametrize(
    ("is_checkout", "remedies"),
    [
        (True, ("git wrote this checkout without links", GIT_REMEDY)),
        (False, ("the archive was unpacked without links", "or clone the repository with git")),
    ],
)
def test_folder_without_symbolic_links_says_so_in_a_sentence(
    tmp_path: Path, *, is_checkout: bool, remedies: tuple[str, str]
) -> None:
    if is_checkout:
        (tmp_path / ".git").mkdir()
    links = [f"pointit/{name}" for name in sources.LINKS]
    files = ("pointit/__init__.py", "pointit/__main__.py", "scripts/demo", "scripts/lib.sh", *links)

    git = ("git", "-c", "core.symlinks=false", "checkout-index", f"--prefix={tmp_path}/")
    subprocess.run([*git, *files], cwd=ROOT, check=True)
    assert (tmp_path / "pointit/services").read_text() == "../services"

    told = python("-m", "pointit", "list", cwd=tmp_path)
    script = subprocess.run([tmp_path / "scripts/demo"], capture_output=True, text=True, check=False)
    for done in (told, script):
        (sentence,) = done.stderr.splitlines()
        for remedy in remedies:
            assert remedy in sentence
        assert ("git config" in sentence) == is_checkout
        assert (done.returncode, done.stdout) == (2, "")

    imported = python("-c", "import pointit", cwd=tmp_path)
    assert f"ImportError: {tmp_path}/pointit: services, schemas and bridges are text files" in imported.stderr


def test_build_of_a_zip_archive_without_links_is_refused(tmp_path: Path) -> None:
    archive = tmp_path / "main.zip"
    git = ("git", "archive", "--format=zip", f"--output={archive}", "HEAD")
    subprocess.run(git, cwd=ROOT, check=True)
    root = tmp_path / "main"
    with zipfile.ZipFile(archive) as opened:  # as pip, uv and Windows do: links become text files
        opened.extractall(root)
    shutil.copy(ROOT / "hatch_build.py", root)
    shutil.copy(ROOT / "pyproject.toml", root)

    for target in ("wheel", "sdist"):
        build = python("-m", "hatchling", "build", "--target", target, cwd=root)

        assert build.returncode != 0
        assert build.stderr.splitlines()[-1].endswith("or clone the repository with git")
        assert "Traceback" not in build.stderr
    assert not list(root.glob("dist/*"))


def test_the_package_is_typed_and_every_room_a_package() -> None:
    assert len(sources.ROOMS) >= 6
    wanted = [
        *(room / "__init__.py" for room in sources.ROOMS),
        *(ROOT / "pointit" / name for name in ("__init__.pyi", "py.typed")),
    ]
    assert not [shown(path) for path in wanted if not path.is_file()]


def folder_of(row: Process) -> Path:
    return HOMES[row.room] / row.package.rpartition(".")[2]


WATCHERS = {HOMES["bridges"] / "mqtt_things"}
"""Bridges that are no processes: `pointit run` and `pointit things react` attach them to their own bus."""


def test_every_service_folder_is_in_the_registry_and_vice_versa() -> None:
    folders = {
        folder
        for home in HOMES.values()
        for folder in home.iterdir()
        if folder.is_dir() and folder.name != "__pycache__"
    }
    assert folders == {folder_of(row) for row in PROCESSES} | WATCHERS


@rows
def test_every_service_has_its_files_and_a_core(row: Process) -> None:
    folder = folder_of(row)
    assert {path.name for path in folder.glob("*.py")} >= {"__init__.py", "service.py"}
    assert {path.name for path in folder.rglob("*.py")} - sources.SHELLS, (
        f"{shown(folder)} has no core: the module named after its idea"
    )


@rows
def test_every_service_is_what_its_row_says(row: Process) -> None:
    service = row.load()
    assert issubclass(service, Service)
    assert (row.name, row.scope) == (service.NAME, service.SCOPE)
    assert issubclass(service.CONFIG, Config)
    assert row.config() is service.CONFIG


@rows
def test_every_parameter_is_described(row: Process) -> None:
    def undescribed(kind: type[Any], prefix: str) -> list[str]:
        lacking: list[str] = []
        for name, field in kind.model_fields.items():
            inner = field.annotation
            if isinstance(inner, type) and issubclass(inner, Config):
                lacking += undescribed(inner, f"{prefix}{name}.")
            elif not field.description:
                lacking.append(f"{prefix}{name}")
        return lacking

    assert undescribed(row.load().CONFIG, "") == []


@rows
def test_cores_know_no_bus_no_clock_and_no_loop(row: Process) -> None:
    cores = tuple(path for path in sorted(folder_of(row).rglob("*.py")) if sources.is_core(path))
    doors = ("asyncio", "threading", "time", "logging", "serial", "pointit.runtime")
    harmless = {place for module in HARMLESS for place in sources.importers(module, cores)}
    found = {place for module in doors for place in sources.importers(module, cores)}
    assert not found - harmless, (
        f"{row.name}: a core gets inputs and the time, and returns messages; "
        "a module that waits or writes files says so by a line `No core: REASON` in its docstring"
    )


def test_module_without_core_says_why_at_the_end_of_its_docstring() -> None:
    marked = [path for path in sources.shipped() if sources.NO_CORE in sources.text(path)]
    assert marked
    for path in marked:
        *_, last = (ast.get_docstring(sources.tree(path)) or "").splitlines()
        assert last.startswith(sources.NO_CORE.strip()), f"{shown(path)}: the line ends the docstring"
        assert last.endswith("."), f"{shown(path)}: the reason is a sentence"


@rows
def test_every_reader_has_a_writer(row: Process) -> None:
    for topic in row.reads:
        written_by = [other.name for other in PROCESSES if topic in other.writes]
        assert written_by or OUTSIDERS & set(topic.writers), f"{row.name} reads {topic.key}, nobody writes it"


@topics
def test_the_tables_agree_on_who_writes(topic: Topic[Any]) -> None:
    assert set(topic.writers) <= NAMES | OUTSIDERS
    assert {row.name for row in PROCESSES if topic in row.writes} == set(topic.writers) - OUTSIDERS


@pytest.mark.parametrize("request_row", [pytest.param(row, id=row.key) for row in REQUESTS])
def test_the_tables_agree_on_who_answers(request_row: Any) -> None:
    answer = {row.name for row in PROCESSES if request_row in row.serves}
    assert answer == {request_row.server} - OUTSIDERS


def test_only_the_runtime_imports_zenoh() -> None:
    runtime = ROOT / "pointit/runtime"
    others = tuple(path for path in sources.shipped() if runtime not in path.parents)
    assert list(sources.importers("zenoh", others)) == []
    assert list(sources.importers("zenoh", sources.shipped())), "this test looks past zenoh"


def test_only_the_codec_imports_msgpack() -> None:
    assert {place.partition(":")[0] for place in sources.importers("msgpack", sources.shipped())} == {
        "schemas/codec.py"
    }


def test_only_per_sample_messages_are_created_without_validation() -> None:
    """Values of devices, plug-ins, files and other programs come in elsewhere, and are validated there."""
    users = sources.importers("pointit.schemas.base.unchecked", sources.shipped())
    assert {place.partition(":")[0] for place in users} == {
        "services/pointing/pointer.py",
        "services/pui/cursor.py",
        "services/selector/hover_engine.py",
    }


def test_services_do_not_import_the_registry_or_each_other() -> None:
    for row in PROCESSES:
        mine = tuple(sorted(folder_of(row).rglob("*.py")))
        others = [each.package for each in PROCESSES if each is not row]
        if row.room == "services":
            others.append("pointit.services.registry")
        assert [place for other in others for place in sources.importers(other, mine)] == []


def test_keys_stand_in_the_topic_table_only() -> None:
    find = finder(patterns())
    tables = {ROOT / "schemas" / name for name in ("topics.py", "robots.py")}
    found = [
        f"{shown(path, literal)} {literal.value!r}"
        for path in sources.shipped()
        if path not in tables
        for literal in sources.literals(path)
        if find.search(str(literal.value))
    ]
    assert not found, "use the rows of pointit.schemas.topics, `IMU.at(user)`: " + "; ".join(found)


@pytest.mark.parametrize(
    "text",
    [
        *("users/anna/imu", "users/", "pointit/lab/users/anna/ray", "@/users/*/imu", "selection/events"),
        *(
            *("leds/brightness", "leds/1/color", "strips/frame", "conveyor/state"),
            *("conveyor/reset", "health/pui"),
        ),
        *("deployment/x", "alive/services/", "alive/users/anna", "localizer/anna/start", "selector/x/clear"),
        *("imu/anna/set_yaw_origin", "see users/{user}/imu"),
    ],
)
def test_keys_are_recognized(text: str) -> None:
    assert finder(patterns()).search(text)


@pytest.mark.parametrize(
    "text",
    [
        *("map", "objects", "strips and/or frames", "/imu", "on users/ or off", "maps/lab.yaml"),
        *("superusers/x", "1/leds"),
    ],
)
def test_everyday_text_is_no_key(text: str) -> None:
    assert not finder(patterns()).search(text)


def test_every_module_is_short_and_says_what_it_is() -> None:
    lines = {path: sources.text(path).splitlines() for path in sources.all_modules()}
    long = [f"{shown(path)} has {len(each)} lines" for path, each in lines.items() if len(each) > LONGEST]
    assert not long, "split by idea"
    code = {path: [line for line in each if line and line[0] != "#"] for path, each in lines.items()}
    mute = [shown(path) for path, each in code.items() if not each or not re.match('r?"""', each[0])]
    assert not mute, "no docstring"


def patterns() -> list[str]:
    """Return the part of each key that identifies it in other text: all, or the part before the placeholder.

    Keys of one word (`map`, `objects`) are everyday words and cannot be identified, nor can `things/`, which
    is a part of MQTT's topics and of namespaces of markers, too.
    """
    heads = {row.key.partition("{")[0] for row in (*TOPICS, *REQUESTS, *PRESENCES)} - {"things/"}
    return sorted(head for head in heads if "/" in head)


def finder(wanted: Iterable[str]) -> re.Pattern[str]:
    """Matches a key wherever it begins: at the start, or after anything but a word, dot or dash.

    The part before a placeholder must be followed by a name, `{`, `*`, or the end of an f-string's piece.
    """
    alternatives = "|".join(
        re.escape(each) + (r"(?=[\w{*$]|\Z)" if each.endswith("/") else r"(?![\w-])") for each in wanted
    )
    return re.compile(rf"(?<![\w.\-])(?:{alternatives})")


WATCHES = {
    "pointit/cli/browser_window.py": 1,  # opens the browser
    "pointit/launch/run/running_scenario.py": 2,  # starts and ends processes
    "pointit/testing/service.py": 1,  # waits for one service
}
"""Watches of services and people outside of services, runtime and `pointit.site`: they only become fewer."""
MAX_WATCHES = 22


def watches(*names: str) -> Counter[str]:
    """Return the number of calls of `watch` with one of these presences, by file of the product."""
    return Counter(
        sources.shown(path)
        for path in sources.shipped()
        for node in ast.walk(sources.tree(path))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "watch"
        if node.args and ast.unparse(node.args[0]).rpartition(".")[2] in names
    )


def test_displays_take_presence_from_the_sites_state() -> None:
    shared = ("services/", "pointit/runtime/", "pointit/site/")
    found = {
        file: count
        for file, count in watches("SERVICE_ALIVE", "USER_ALIVE").items()
        if not file.startswith(shared)
    }
    assert found == WATCHES, "follow a `SiteState`; shorten the list if one is gone"
    assert sum(watches("SERVICE_ALIVE", "USER_ALIVE", "SHARD_ALIVE").values()) <= MAX_WATCHES
