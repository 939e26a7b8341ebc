"""The type checker finds seventeen deliberate errors, so that a weaker setting of it is noticed."""

import json
import subprocess
import sys
from pathlib import Path

from tests.architecture.sources import ROOT

MARK = "  # error: "
WRONG = """\
import asyncio
from collections.abc import Callable, Sequence
from pathlib import Path

from pointit.runtime.bus.contract import Bus
from pointit.runtime.clock import Clock
from pointit.schemas import Cursor, Done, PointingRay
from pointit.schemas.requests import SetHeading, SetMethod
from pointit.schemas.topics import CURSOR, SET_HEADING, SET_METHOD, Topic
from pointit.services.imu_bridge.sources import Deliver, Source


RAY = PointingRay(stamp_ns=1, origin_m=(0.0, 0.0, 1.0), direction=(1.0, 0.0, 0.0))


def on_ray(ray: PointingRay, user: str) -> None:
    print(ray.range_m, user)  # error: unknown field of a message


def joined(bus: Bus) -> None:
    bus.subscribe(CURSOR, on_ray)  # error: wrong handler of a topic
    bus.publisher(CURSOR).put(RAY)  # error: wrong message
    bus.serve(SET_METHOD, turned)  # error: wrong server of a request


async def turned(query: SetHeading, user: str) -> Done:
    return Done(message=f"{user} {query}")


async def asked(bus: Bus) -> str:
    bus.call(SET_HEADING, SetHeading(yaw_rad=0.0), "anna")  # error: forgotten await
    done = await bus.call(SET_HEADING, SetMethod(method="hold"), "anna")  # error: query of another request
    return done.messages  # error: unknown field of a reply


def made() -> Cursor:
    return Cursor(stamp_ns=1, surface="ceiling")  # error: none of the values of a field


def moved(cursor: Cursor) -> float:
    cursor.range_m = 2.0  # error: messages are frozen
    return cursor.point_m[0]  # error: None is not excluded


def chosen(*, is_near: bool) -> str:  # error: missing return
    if is_near:
        return "near"


class Silent:
    def run(self, deliver: Deliver) -> None:
        print(deliver)


SOURCE: Source = Silent()  # error: protocol mismatch


def counted(names: Sequence[str]) -> int:
    for name in names:
        last = name
    return len(last)  # error: unbound name


def keys(topics: list[Topic]) -> list[str]:  # error: missing type arguments
    return [topic.key for topic in topics]


def written(path, text: str) -> None:  # error: missing annotation
    Path(path).write_text(text, encoding="utf-8")


class Still(Clock):
    def now_ns(self, zone: str) -> int:  # error: override with another signature
        return len(zone)


async def later(call: Callable[[str], int]) -> int:
    return await asyncio.to_thread(call, 1)  # error: wrong argument through a call of a call
"""


def test_type_checker_finds_exactly_seventeen_errors(tmp_path: Path) -> None:
    file = tmp_path / "wrong.py"
    file.write_text(WRONG, encoding="utf-8")
    pyrefly = Path(sys.executable).with_name("pyrefly")
    command = (pyrefly, "check", "--config", ROOT / "pyproject.toml", "--output-format", "json", file)
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 1, done.stderr
    found = {error["line"]: error["description"] for error in json.loads(done.stdout)["errors"]}
    lines = enumerate(WRONG.splitlines(), 1)
    wrong = {line: text.partition(MARK)[2] for line, text in lines if MARK in text}
    assert len(wrong) == 17
    assert [error for line, error in wrong.items() if line not in found] == []
    assert {line: said for line, said in found.items() if line not in wrong} == {}
