"""A machine with clock skew, as a real process: doctor names it, whether or not there is a keeper."""

import asyncio
import json
import sys
from typing import Any

import pytest

from tests.support.bench import until
from tests.support.commands import Commands, onlooker

SKEWED = """\
import socket, sys, time
real = time.time_ns
time.time_ns = lambda: real() + int({ahead_s} * 1e9)
socket.gethostname = lambda: "watch"
sys.argv = ["pointit", "service", "run", "pointing", "--user", "anna", "--connect", "{endpoint}"]
from pointit.cli.main import main
main()
"""


async def found(commands: Commands, endpoint: str) -> list[dict[str, Any]]:
    """Return doctor's findings on clocks, its own or the keeper's warning."""
    report = json.loads((await commands.pointit("doctor", "--json", "--connect", endpoint)).out)
    return [finding for finding in report["findings"] if "the clock of machine" in finding["sentence"]]


@pytest.mark.long
@pytest.mark.parametrize(
    ("keeper", "ahead_s"), [(True, 1.5), (True, -0.2), (True, 0.0), (False, 1.5), (False, -1.5)]
)
async def test_doctor_names_the_machine(
    commands: Commands,
    endpoint: str,
    keeper: bool,  # noqa: FBT001
    ahead_s: float,
) -> None:
    if keeper:
        commands.start("run", "scenario_2", "--site-only", "--no-view", "--listen", endpoint)
    else:
        commands.start("router", "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        if keeper:
            await seen.hears("keeper")
        commands.run([sys.executable, "-c", SKEWED.format(ahead_s=ahead_s, endpoint=endpoint)])
        await seen.hears("pointing.anna")
        await asyncio.sleep(3.0 if ahead_s else 10.0)  # time enough for a false report on a right clock
        if keeper and ahead_s:
            await until(
                lambda: any("clock of machine watch" in w for w in seen.health["keeper"].warnings), 20
            )
        findings = await found(commands, endpoint)
        assert len(findings) == (1 if ahead_s else 0)
        for finding in findings:
            way = "ahead of" if ahead_s > 0 else "behind"
            assert f"machine watch is {abs(ahead_s):.1f} s {way}" in finding["sentence"] or abs(ahead_s) < 1
            assert "NTP" in finding["sentence"] + finding["remedy"]
