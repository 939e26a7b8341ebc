"""The plug-ins that come with PointIt, and those that `pointit plugin new` writes, keep all promises."""

import contextlib
import socket
from collections.abc import Generator
from dataclasses import replace
from importlib import import_module
from typing import Any

import pytest

from pointit.cli.plugins import new
from pointit.plugins import GROUPS, Config
from pointit.testing import Harness, checks, run_checks
from pointit.testing.installed import installed_harness

WITHOUT_STRIPS = {"spotlight"}
"""LED outputs without strips and lamps, which are what the kit checks."""

ELSEWHERE = {"ros2"}
"""Robot drivers whose promises are checked beside their other tests: the kit must not import bridges."""

OURS = [
    pytest.param(installed_harness(name, group.get(name)), id=f"{kind} {name}", marks=pytest.mark.slow)
    for kind, group in GROUPS.items()
    for name in group.names
    if group.package(name) == "pointit" and name not in WITHOUT_STRIPS | ELSEWHERE
]
TEMPLATES = [
    pytest.param(import_module(f"{new.TEMPLATES}.{template}.fake").DEVICE, id=template)
    for template, *_ in new.KINDS.values()
]


@contextlib.contextmanager
def usual_port_taken(config: type[Config]) -> Generator[None]:
    """Have the port that a plug-in with these parameters uses unless told otherwise."""
    field = config.model_fields.get("port")
    port = field.default if field is not None and isinstance(field.default, int) else 0
    with socket.socket() as stream, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as datagrams:
        for taken in (stream, datagrams):
            with contextlib.suppress(OSError):  # somebody else has it, which is as good
                taken.bind(("", port))
        stream.listen()
        yield


def test_fake_device_of_another_plugin_of_that_name_is_not_used() -> None:
    serial = GROUPS["imu-source"].get("serial")
    assert installed_harness("serial", replace(serial)) is None


@pytest.mark.parametrize("harness", [*OURS, *TEMPLATES])
def test_plugin_keeps_all_promises_beside_a_run_that_has_its_usual_port(harness: Harness[Any] | None) -> None:
    assert harness is not None, "declare its fake device in pyproject.toml"
    with usual_port_taken(harness.plugin.config):
        found = dict(run_checks(checks(harness)))
    assert len(found) >= 7
    assert not [problem for problem in found.values() if problem]
