"""Listings of plug-ins and services: complete, and without running code of other packages."""

import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from pointit.cli.inspect.listings import plugins, services
from pointit.cli.main import front
from pointit.plugins import GROUPS
from pointit.services import registry
from tests.support import strangers

COMMAND = "my-tally"
PACKAGE = "strangers-parts"
SUMMARY = "Parts of a radio"
ENTRIES = {
    "imu_sources": "plain-wave = strangers_plain:WAVING",
    "led_outputs": "plain-lamp = strangers_plain:LAMP",
    "selection_methods": "plain-way = strangers_plain:WAY",
    "recognisers": "plain-ears = strangers_plain:EARS",
    "services": "tally = strangers_plain:TALLY_SERVICE",
    "commands": f"{COMMAND} = strangers_plain:report\nrun = strangers_plain:run",
}


@pytest.fixture
def plain(tmp_path: Path) -> Iterator[None]:
    with strangers.installed(tmp_path, "strangers_plain", "raise RuntimeError", **ENTRIES):
        with (tmp_path / "strangers_parts-1.0.dist-info" / "METADATA").open("a") as metadata:
            metadata.write(f"Summary: {SUMMARY}\n")
        yield
    assert "strangers_plain" not in sys.modules


@pytest.mark.usefixtures("plain")
def test_plug_ins_of_each_kind_are_listed_without_importing_their_modules() -> None:
    group = front()
    with click.Context(group):
        rows = {row["use"]: row for row in plugins().rows if row["package"] == PACKAGE}
    assert {use: row["about"] for use, row in rows.items() if row["name"] != "run"} == {
        "--imu plain-wave": SUMMARY,
        "--output plain-lamp": SUMMARY,
        "--method plain-way": SUMMARY,
        "listen --recogniser plain-ears": SUMMARY,
        "--with tally": SUMMARY,
        f"pointit {COMMAND}": SUMMARY,
    }
    assert (
        f"{PACKAGE} adds no command 'run', which is a name of PointIt's own" in rows["pointit run"]["about"]
    )


@pytest.mark.usefixtures("plain")
def test_service_of_another_package_is_listed_without_importing_its_module() -> None:
    (row,) = (row for row in services().rows if row["name"] == "tally")
    assert row["about"] == f"{SUMMARY} ({PACKAGE})"
    assert (row["scope"], row["reads"]) == (None, None)
    assert [row["name"] for row in services().rows if row["name"] == "web"] == ["web"]
    assert "tally" not in [row.name for row in registry.PROCESSES]


def test_own_plug_ins_are_listed_with_summary_and_argument() -> None:
    rows = {row["name"]: row for row in plugins().rows}
    for group in GROUPS.values():
        for name in group.names:
            plugin = group.get(name)
            assert rows[name]["about"] == plugin.summary
            assert rows[name]["use"].endswith(f"{name}{plugin.value}")
