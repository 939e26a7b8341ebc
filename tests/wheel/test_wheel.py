"""The wheel in environments of its own: everything that commands read is inside."""

import functools
import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import uv

from tests.architecture.sources import ROOT
from tests.e2e.run.visitor import entered
from tests.support.commands import Commands
from tests.support.links import link_in

pytestmark = [pytest.mark.slow, pytest.mark.index]

ROOTS = {
    "pointit/": "pointit/",
    **{f"{name}/": f"pointit/{name}/" for name in ("schemas", "services", "bridges")},
}
"""Folders of the repository, and where they are in the wheel."""
LEFT_OUT = (
    "bridges/web/client/",  # what the page is built from
    *(f"pointit/{name}" for name in ("schemas", "services", "bridges")),  # links
)
TYPED = """\
# pyright: strict
from typing import assert_type

import pointit
from pointit.bridges.web.server import certificate
from pointit.plugins import ImuSource
from pointit.schemas import Cursor


async def main() -> None:
    async with pointit.connect() as site:
        assert_type(site, pointit.Site)
    async with pointit.run("scenario_3") as site:
        assert_type(site, pointit.Site)
    with pointit.open() as opened:
        assert_type(opened, pointit.SyncSite)
    assert_type(Cursor(stamp_ns=1).range_m, float)
    print(pointit.PointItError("no"), pointit.__version__, ImuSource, certificate.__name__)
"""
"""Program that uses names of all rooms."""
UV = uv.find_uv_bin()
INSTALL_S = 200.0
"""Limit of an installation from the index, where the cache of uv lacks something."""
LOCK = ("--constraints", str(ROOT / "requirements" / "image.txt"))


def run(*command: str | Path, cwd: Path) -> str:
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False, timeout=INSTALL_S)
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build what a release has: archives, from them the wheels; that of the laboratory lies beside ours."""
    folder = tmp_path_factory.mktemp("dist")
    run(ROOT / "scripts" / "release", "--dry-run", folder, cwd=folder)
    assert len([*folder.glob("*.tar.gz")]) == 2
    run("sha256sum", "--check", "SHA256SUMS", cwd=folder)
    (libraries,) = folder.glob("*.cdx.json")
    assert "eclipse-zenoh" in {each["name"] for each in json.loads(libraries.read_text())["components"]}
    (built,) = folder.glob("pointit-*.whl")
    return built


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run commands outside the checkout."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def plain(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the wheel without extras into an empty environment; return its `pointit`."""
    folder = tmp_path_factory.mktemp("empty") / "venv"
    run(UV, "venv", "--quiet", "--python", sys.executable, folder, cwd=folder.parent)
    python = folder / "bin" / "python"
    run(UV, "pip", "install", "--quiet", "--python", python, *LOCK, wheel, cwd=folder.parent)
    return folder / "bin" / "pointit"


def test_wheel_has_every_file_of_the_product_and_no_other(wheel: Path) -> None:
    tracked = run("git", "ls-files", "-co", "--exclude-standard", *ROOTS, cwd=ROOT).splitlines()
    wanted = set[str]()
    for path in tracked:
        root = next(root for root in ROOTS if path.startswith(root))
        if not path.startswith(LEFT_OUT):
            wanted.add(ROOTS[root] + path.removeprefix(root))
    with zipfile.ZipFile(wheel) as archive:
        there = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert there == wanted


async def test_scenario_runs_without_the_page_and_names_the_extra(plain: Path, commands: Commands) -> None:
    ended = await commands.run([str(plain), "run", "scenario_3", "--duration", "5"]).end(code=0)
    assert "scenario_3 ran" in ended.out
    assert "There was no page: the page needs `" in ended.out
    assert re.search(r"pip install .*'uvicorn>=[\d.]+'", ended.out)  # `uv pip` where uv made the environment


async def test_commands_find_what_they_read(plain: Path, commands: Commands) -> None:
    async def says(*arguments: str, code: int = 0) -> str:
        ended = await commands.run([str(plain), *arguments]).end(code=code)
        return ended.out + ended.err

    assert "conveyor" in await says("map", "list")
    listed = await says("list")
    assert all(name in listed for name in ("scenario_3", "conveyor", "--imu serial", "--output expander:"))
    assert "of pointit cannot be imported" not in listed
    assert "is up to date" in await says("topic", "schema", "--check")
    assert "ImuSample.v1" in await says("topic", "schema", "ImuSample.v1")
    refused = await says("map", "plot", "conveyor", "-o", "conveyor.svg", code=2)
    assert "pictures need matplotlib, which is not installed; run `" in refused
    assert re.search(r"pip install .*'matplotlib>=[\d.]+'", refused)


async def test_laboratory_beside_adds_its_commands(wheel: Path, plain: Path, commands: Commands) -> None:
    (laboratory,) = wheel.parent.glob("pointit_lab-*.whl")
    tracked = run("git", "ls-files", "-co", "--exclude-standard", "lab/pointit_lab", cwd=ROOT).splitlines()
    with zipfile.ZipFile(laboratory) as archive:
        there = {f"lab/{name}" for name in archive.namelist() if ".dist-info/" not in name}
    assert there == set(tracked)
    ended = await commands.run([str(plain), "--help"]).end()
    assert "evaluate" not in ended.out
    refused = await commands.run([str(plain), "evaluate", "selection"]).end()
    install = f"uv pip install --python {plain.with_name('python')}"  # uv has made the environment
    remedy = f"`{install} {laboratory.name}`; `scripts/wheel` makes this file in a checkout of PointIt"
    assert (refused.code, refused.out) == (2, "")
    assert refused.err == (
        f"Error: `pointit evaluate` is a command of pointit-lab, which is not installed; run {remedy}\n"
    )
    refused = await commands.run([str(plain), "plugin", "check", "hold"]).end()
    assert (refused.code, refused.out) == (2, "")
    assert refused.err == "Error: pytest is not installed; run `pip install pytest`\n"
    refused = await commands.run([str(plain), "plugin", "check", "simulated"]).end()
    assert (refused.code, refused.out) == (2, "")
    assert f"with devices of pointit-lab, which is not installed; run {remedy}" in refused.err
    python = plain.with_name("python")
    run(UV, "pip", "install", "--quiet", "--python", python, *LOCK, laboratory, "pytest", cwd=plain.parent)
    try:
        ended = await commands.run([str(plain), "--help"]).end()
        assert "evaluate" in ended.out
        one = ("--bench", "belts_lab", "--method", "gauge", "--trials", "1")
        ended = await commands.run([str(plain), "evaluate", "selection", *one]).end(code=0)
        assert "gauge" in ended.out
        ended = await commands.run([str(plain), "plugin", "check", "simulated"]).end()
        assert ended.code == 0, ended.out
    finally:
        run(UV, "pip", "uninstall", "--quiet", "--python", python, "pointit-lab", "pytest", cwd=plain.parent)


async def test_uvx_without_arguments_does_what_scripts_demo_does(wheel: Path, commands: Commands) -> None:
    uvx = functools.partial(commands.run, environment={"UV_PYTHON": sys.executable})
    where = ("tool", "run", "--quiet", *LOCK, "--from", f"{wheel}[web]", "pointit")
    command = uvx([UV, *where])
    await command.says("`pointit` alone is `pointit run`")
    await command.says("its link is in")
    _, page = await entered(link_in(command.err + command.out))
    assert page.status_code == 200
    assert "text/html" in page.headers["content-type"]
    ended = await command.stop(code=0)
    assert "scenario_4 ran" in ended.out


@pytest.fixture(scope="module")
def checkers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the type checkers of users into an environment of their own; return its commands."""
    folder = tmp_path_factory.mktemp("checkers") / "venv"
    run(UV, "venv", "--quiet", "--python", sys.executable, folder, cwd=folder.parent)
    python = folder / "bin" / "python"
    run(UV, "pip", "install", "--quiet", "--python", python, "mypy", "pyright[nodejs]", cwd=folder.parent)
    return folder / "bin"


@pytest.mark.long
@pytest.mark.parametrize("where", ["editable install", "wheel"])
def test_type_checkers_of_users_see_all_names_of(
    where: str, checkers: Path, plain: Path, tmp_path: Path
) -> None:
    """Run them without any configuration, on a program outside the checkout, as an editor does."""
    python = plain.with_name("python") if where == "wheel" else sys.executable
    (tmp_path / "reactions.py").write_text(TYPED, encoding="utf-8")
    said = run(checkers / "pyright", "--pythonpath", python, "reactions.py", cwd=tmp_path)
    assert "0 errors, 0 warnings" in said
    mypy = (checkers / "mypy", "--strict", "--cache-dir", tmp_path / "cache", "--config-file", "")
    said = run(*mypy, "--python-executable", python, "reactions.py", cwd=tmp_path)
    assert "no issues found in 1 source file" in said


def test_pyrefly_sees_all_names_of_the_wheel(plain: Path, tmp_path: Path) -> None:
    (tmp_path / "reactions.py").write_text(TYPED, encoding="utf-8")
    (tmp_path / "pyrefly.toml").write_text('preset = "strict"\nmin-severity = "warn"\n', encoding="utf-8")
    pyrefly = Path(sys.executable).with_name("pyrefly")
    python = plain.with_name("python")
    run(pyrefly, "check", "--python-interpreter-path", python, "reactions.py", cwd=tmp_path)
