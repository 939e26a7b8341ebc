"""Each who tells a peer something at the same time gets the answer to that, and not another's."""

import asyncio
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.told import Told

ECHO = """
import json, sys, time
print("{}", flush=True)
for line in sys.stdin:
    order = json.loads(line)
    time.sleep(order["s"])
    print(json.dumps({"value": order["number"]}), flush=True)
"""


@pytest.fixture
def echo(tmp_path: Path) -> Iterator[Told]:
    told = Told("echo", (sys.executable, "-c", ECHO), tmp_path / "stderr")
    try:
        told.wait()
        yield told
    finally:
        told.kill()


async def test_answers_go_to_who_asked(echo: Told) -> None:
    numbers = range(40)
    answers = await asyncio.gather(*(echo.do("say", number=each, s=0.001 * (each % 5)) for each in numbers))
    assert answers == list(numbers)
