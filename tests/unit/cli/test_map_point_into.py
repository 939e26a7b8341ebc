"""`pointit map point --into`: things of a Home Assistant get their positions by pointing."""

import asyncio
import math
import re
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from click.testing import CliRunner

from pointit.cli.main import command
from pointit.cli.maps.home_assistant import HomeEntity, with_things
from pointit.cli.maps.point import PointingSession, place_things
from pointit.maps.checks.check import examined
from pointit.maps.file import load_map, read_map_file
from pointit.runtime.errors import RefusedError
from pointit.schemas import ButtonEvent, PointingRay, UseMap, UseMapReply, UserPose
from pointit.schemas.topics import BUTTON, POSE, RAY, USE_MAP
from tests.support.bench import Bench, memory_bench
from tests.unit.scan.test_by_pointing import EYES, LAMPS, pointed

MINE = b"# mine\nthings:\n  shelf: {center: [0, 3, 1], size: [1, 0.4, 0.4]}  # stays\n"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a map with a thing of its own and the imported lamps `a`, `b` and `c`."""
    entities = [HomeEntity("Kitchen", f"light.{name}", f"Lamp {name}", "off") for name in LAMPS]
    path = tmp_path / "home.yaml"
    path.write_bytes(with_things(MINE, path, entities)[0])
    return path


def content_of(path: Path) -> bytes:
    return path.read_bytes()


def put(path: Path, content: bytes) -> None:
    path.write_bytes(content)


@asynccontextmanager
async def pointing_person(bench: Bench) -> AsyncGenerator[PointingSession]:
    """Yield the session of a person who goes where they are asked to, and points exactly."""
    place = 0

    def stand() -> None:
        x, y, _ = EYES[place]
        bench.put(POSE, UserPose(stamp_ns=place + 1, position_m=(x, y, 0.0), yaw_rad=0.0), "anna")

    def obey(text: str) -> None:
        nonlocal place
        if "another position" in text:
            place += 1
            stand()
        elif asked := re.search(r"point at (\S+) and press", text):
            direction = pointed(LAMPS[asked[1]], EYES[place])
            ray = PointingRay(stamp_ns=1, origin_m=(0.0, 0.0, 1.6), direction=direction)
            loop = asyncio.get_running_loop()
            loop.call_later(0.01, bench.put, RAY, ray, "anna")
            loop.call_later(0.02, bench.put, BUTTON, ButtonEvent(stamp_ns=1), "anna")

    session = PointingSession(bench.bus, "anna", obey)
    stand()
    yield session


async def test_imported_things_get_centers_that_the_site_uses_at_once(file: Path) -> None:
    used: list[str] = []

    async def use_map(query: UseMap, _name: str) -> UseMapReply:
        used.append(query.path)
        return UseMapReply(message="used", path=str(file))

    async with memory_bench() as bench, pointing_person(bench) as session:
        bench.bus.serve(USE_MAP, use_map)
        assert await place_things(["a", "b"], file)(session) == ("", 0)
    assert used == ["", str(file)]
    things = {each.id: each for each in load_map(str(file), 0).things}
    for name in ("a", "b"):
        assert math.dist(things[name].center_m, LAMPS[name]) < 0.02
        assert (things[name].home_assistant, things[name].label) == (f"light.{name}", f"Lamp {name}")
        assert not things[name].is_tracked, "people can point at it"
    assert things["c"].is_tracked
    assert content_of(file).startswith(MINE)
    assert b"  c: {home_assistant: light.c, label: Lamp c}" in content_of(file)


async def test_site_with_a_shipped_map_reportedly_uses_another_file(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async def use_map(_query: UseMap, _name: str) -> UseMapReply:
        return UseMapReply(message="used", path="shelf")

    async with memory_bench() as bench, pointing_person(bench) as session:
        bench.bus.serve(USE_MAP, use_map)
        assert await place_things(["a"], file)(session) == ("", 0)
    assert "which the site does not use: it uses shelf" in capsys.readouterr().out


async def test_placed_things_may_be_placed_again_and_keep_their_size(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    action = "{entity: light.a, action: light.turn_on, data: {brightness_pct: 40}}"
    size = "size: [0.2, 0.2, 0.5]\n    center: [9, 9, 9]"
    put(file, f"things:\n  a:\n    home_assistant: {action}\n    {size}\n".encode())
    async with memory_bench() as bench, pointing_person(bench) as session:
        assert await place_things(["a"], file)(session) == ("", 0)
    entry = read_map_file(file).things["a"]
    assert entry.size == (0.2, 0.2, 0.5)
    assert entry.center is not None
    assert math.dist(entry.center, LAMPS["a"]) < 0.02
    assert "which the site uses from its next start on (pui does not answer" in capsys.readouterr().out


async def test_thing_that_was_removed_meanwhile_loses_no_positions(file: Path) -> None:
    async with memory_bench() as bench, pointing_person(bench) as session:
        work = place_things(["a", "b"], file)
        put(file, MINE)
        with pytest.raises(
            RefusedError, match=r"things\.a is not in the file.*yourself: \{'a': \[-0\.5"
        ) as caught:
            await work(session)
    assert "'b': [0.4" in str(caught.value)
    assert content_of(file) == MINE


def test_unknown_or_otherwise_placed_things_are_refused(file: Path) -> None:
    file.write_text(file.read_text() + "  cart: {at: object, home_assistant: light.d}\n")
    for name, sentence in (("aa", "has no thing 'aa'"), ("cart", "cart has `at`, which says where it is")):
        result = CliRunner().invoke(command, ["map", "point", "anna", name, "--into", str(file)])
        assert sentence in str(result.exception)


def test_check_of_a_map_lists_what_nobody_can_point_at(file: Path) -> None:
    _has, findings = examined("home", file, lambda: read_map_file(file))
    (finding,) = (each for each in findings if "without a position" in each.text)
    assert finding.text == (
        "a, b, c: without a position, nobody can point there; place them by "
        "`pointit map point USER a --into MAP`"
    )
