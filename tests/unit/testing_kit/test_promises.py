"""Our own plug-ins and the templates keep all promises, beside a run that has their usual ports."""

import contextlib
import socket
from collections.abc import Generator
from importlib import import_module

import pytest

from pointit.cli.plugins import check
from pointit.plugins import GROUPS
from pointit.testing import Contract

pytestmark = pytest.mark.slow
WITHOUT_STRIPS = {"spotlight"}
"""LED outputs without strips and lamps, which are what the contract is about."""
ELSEWHERE = {"ros2", "pocketsphinx"}
"""Plug-ins that are tested beside their other tests: the kit imports no bridge, and has no spoken words."""
OURS = {
    f"{kind}_{name}": check.installed_contract(name, group.get(name))
    for kind, group in GROUPS.items()
    for name in group.names
    if group.package(name) == "pointit" and name not in WITHOUT_STRIPS | ELSEWHERE
}
TEMPLATES = {
    template: getattr(
        import_module(f"{check.TEMPLATES}.{template}.promises"), f"{thing.capitalize()}Promises"
    )
    for kind, (template, _, thing, _) in check.KINDS.items()
    if kind != check.COMMAND
}
globals().update({f"Test_{name}": contract for name, contract in (OURS | TEMPLATES).items()})


@pytest.mark.parametrize("name", OURS)
def test_our_plugin_has_a_contract(name: str) -> None:
    contract = OURS[name]
    assert contract is not None, "declare its fake device in lab/pyproject.toml"
    assert issubclass(contract, Contract)


@pytest.fixture(autouse=True)
def _usual_port_taken(request: pytest.FixtureRequest) -> Generator[None]:
    """Have the port that the tested plug-in uses unless told otherwise."""
    fields = request.cls.plugin.config.model_fields if request.cls is not None else {}
    port = fields["port"].default if "port" in fields else 0
    with socket.socket() as stream, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as datagrams:
        for taken in (stream, datagrams):
            with contextlib.suppress(OSError):  # somebody else has it, which is as good
                taken.bind(("", port if isinstance(port, int) else 0))
        stream.listen()
        yield
