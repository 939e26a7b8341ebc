"""`pointit load --hosts`: people over several machines, their routers and what crosses their links."""

import json
import signal
import subprocess
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.support.bench import until
from tests.support.commands import Commands, Ended

SHORT = ("--users", "4", "--rate", "50", "--duration", "3", "--json")
PEOPLE = ["site", "people 1", "people 2"]
STRAY_HZ = 5
"""Limit of messages on a link where nobody looks, 5 % of the samples."""
TRY = "ip link add name try0 type veth peer name try1"
"""Command that a machine has to permit."""


def row_of(ended: Ended) -> dict[str, Any]:
    assert ended.out, ended.err
    (row,) = json.loads(ended.out)["measured"]
    assert ended.code == (0 if row["carried"] else 1), ended.err
    assert 40 < row["sent"] <= 600, "a busy machine leaves some out"
    assert row["cursors"] > 40
    assert row["frames"] > 2
    assert row["lost_percent"] < 50, "cursors cross the link to the lights"
    assert row["hosts"] == 2
    assert all(process["memory_mb"] > 10 for process in row["processes"])
    return dict(row)


def namespaces_or_skip() -> None:
    """Skip without root. Continuous integration fails then: nothing else counts on links."""
    try:
        command = ("unshare", "--net", "sh", "-c", TRY)
        tried = subprocess.run(command, capture_output=True, check=False)
    except FileNotFoundError:
        pytest.skip("needs unshare (util-linux)")
    if tried.returncode:
        pytest.skip("needs root on Linux and `ip`, to make network namespaces")


def without_namespaces(folder: Path) -> dict[str, str]:
    """Return an environment in which no namespace can be made."""
    folder.mkdir()
    return {"PATH": str(folder)}


async def test_rays_of_people_whom_shards_serve_cross_no_link(commands: Commands) -> None:
    namespaces_or_skip()
    sharded = row_of(await commands.pointit("load", *SHORT, "--hosts", "2", "--routers", "3"))
    first, second = sharded["links"]
    assert (first["name"], second["name"]) == ("host 1 > above 1", "host 2 > above 1")
    assert second["up_hz"]["Cursor"] > 10, "led-driver looks"
    assert first["up_hz"]["TrackedObjects"] > 0, "it was counted"
    assert first["up_hz"].get("Cursor", 0) < STRAY_HZ, "nobody looks"
    for link in sharded["links"]:
        assert all(each.get("PointingRay", 0) < STRAY_HZ for each in (link["up_hz"], link["down_hz"]))
    assert not [process for process in sharded["processes"] if process["name"].startswith("router above 2")]


async def test_a_secured_tree_of_routers_carries_people_without_namespaces(
    commands: Commands, tmp_path: Path
) -> None:
    options = ("--hosts", "2", "--routers", "3", "--fan", "1", "--secured")
    ended = await commands.pointit("load", *SHORT, *options, environment=without_namespaces(tmp_path / "bin"))
    row = row_of(ended)
    routers = [process["name"] for process in row["processes"] if process["name"] not in PEOPLE]
    assert routers == ["router above 1", "router host 1", "router host 2"]
    assert row["links"] == []
    assert "unshare" in row["lacking"]
    assert "hosts are processes on loopback, and their links are not measured" in ended.err


async def test_several_numbers_of_people_have_slopes(commands: Commands) -> None:
    ended = await commands.pointit("load", "--users", "1,2,4", "--rate", "20", "--duration", "1")
    assert ended.code in {0, 1}, ended.err
    if "could be sent" not in ended.out:  # a busy machine
        assert "Slopes: with 95 % intervals" in ended.out
        assert "all processes" in ended.out
    assert [line.split()[0] for line in ended.out.splitlines()[4:7]] == ["1", "2", "4"]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--hosts", "2", "--layout", "users"), "--hosts makes a site and processes of its own"),
        (("--users", "1,x"), "'x' is not a whole number from 1 to 1000"),
        (("--hosts", "0"), "'0' is not a whole number from 1 to 16"),
    ],
)
async def test_wrong_options_are_said(commands: Commands, options: tuple[str, ...], sentence: str) -> None:
    ended = await commands.pointit("load", *options, code=2)
    assert sentence in ended.err


def has_not_ended(process: psutil.Process) -> bool:
    """Tell a process that runs from a zombie: nobody may ask for the exit code of an orphan."""
    try:
        return process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


async def test_a_killed_load_leaves_no_process_and_so_no_namespace(commands: Commands) -> None:
    load = commands.start("load", "--duration", "600", "--hosts", "2", "--users", "2", "--central")
    await load.says("measuring")
    family = load.family()
    assert len([process for process in family if "--config" in process.cmdline()]) == 2, "the routers"
    await load.stop(signal.SIGKILL)
    await until(lambda: not any(has_not_ended(process) for process in family), 5, "all to be gone")
