"""A run of twenty minutes with three people, things, a recorder and pages: what it holds does not grow."""

import asyncio
import contextlib
import json
import os
import statistics
import sys
from pathlib import Path

import pytest

from tests.e2e.run.test_page import address_of
from tests.support.bare_pages import look_on
from tests.support.commands import Command, Commands, onlooker

DURATION_S = float(os.environ.get("POINTIT_SOAK_S", "1200"))
WARM_UP_S = min(600.0, 0.5 * DURATION_S)
"""Time until the page's last ten minutes are full, s. In shorter runs memory still grows by them."""
PERIOD_S = 5.0
VISIT_S = 2.0
"""Duration of each visit of the page, one after another, beside one page that stays open, s."""
LIMITS = {"memory_mb": 15.0, "files": 4.0, "threads": 2.0, "tasks": 6.0}
"""Maximum growth from the first to the last quarter after warming up."""

pytestmark = [pytest.mark.long, pytest.mark.timeout(DURATION_S + 600.0)]


def samples_of(command: Command) -> list[dict[str, float]]:
    return [json.loads(line) for line in command.err.splitlines() if line.startswith('{"soak_s"')]


async def visit(url: str) -> None:
    """Open and close the page without end."""
    while True:
        await look_on(url, 1, VISIT_S)


async def test_run_does_not_grow_in_memory_files_threads_or_tasks(
    commands: Commands, endpoint: str, tmp_path: Path
) -> None:
    recording = tmp_path / "soak.mcap"
    program = [sys.executable, "-m", "tests.e2e.run.soaked", str(PERIOD_S), "run", "shelf", "--users", "3"]
    options = ["--no-view", "--web-port", "0", "--listen", endpoint, "--record", str(recording)]
    command = commands.run([*program, *options, "--duration", str(DURATION_S + 300.0)])
    url = await address_of(command)
    async with onlooker(endpoint) as seen:
        visits = asyncio.create_task(visit(url))
        await look_on(url, 1, DURATION_S)
        visits.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await visits
        for user in ("user1", "user2", "user3"):
            await seen.sees_more(seen.cursors[user], f"cursors of {user}")
    samples = [each for each in samples_of(command) if each["soak_s"] > WARM_UP_S]

    assert recording.stat().st_size > 0
    await command.stop(code=0)
    quarter = len(samples) // 4
    assert quarter > 0, "there are samples"

    growth: dict[str, float] = {}
    for name, limit in LIMITS.items():
        first, last = (
            statistics.median(each[name] for each in part) for part in (samples[:quarter], samples[-quarter:])
        )
        growth[name] = last - first
        sys.stdout.write(
            f"{name}: {first:g} to {last:g}, most {max(each[name] for each in samples):g}, "
            f"limit of growth {limit:g}\n"
        )
    assert {name for name, limit in LIMITS.items() if growth[name] > limit} == set()
