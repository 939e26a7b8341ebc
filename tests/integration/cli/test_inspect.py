"""`pointit topic echo`, `topic hz` and `trace` on a site."""

import asyncio
import json
import shlex
import sys
import time
from collections.abc import AsyncIterator

import pytest
import pytest_asyncio
import yaml

import pointit.schemas as models
from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas.topics import CURSOR, HEALTH, MAP, RAY, STRIPS_FRAME
from pointit.services.pointing.service import Pointing
from tests.support import there
from tests.support.bench import until
from tests.support.cli_site import Site, interrupt, next_line
from tests.support.commands import PATIENCE_S
from tests.support.pace import within

ROOM = models.Environment(
    stamp_ns=1,
    name="room",
    strips=(models.Strip(id="left", line_m=((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), pixels=30),),
)


async def test_echo_prints_everybodys_messages(site: Site) -> None:
    site.feed_imu("anna")
    site.feed_imu("ben")
    ended = await site.pointit("topic", "echo", "users/*/imu", "--count", "250")  # longer than its patience
    assert (ended.code, ended.err) == (0, "")
    lines = [yaml.safe_load(line) for line in ended.out.splitlines()]
    assert len(lines) == 250
    assert {key for line in lines for key in line} == {"users/anna/imu", "users/ben/imu"}
    assert all(value["orientation_xyzw"] == [0, 0, 0, 1] for line in lines for value in line.values())


async def test_echo_shows_a_state_that_was_put_before(site: Site) -> None:
    site.bus.publisher(MAP).put(ROOM)
    ended = await site.pointit("topic", "echo", "map", "--count", "1", "--json", code=0)
    assert json.loads(ended.out) == {"key": "map", **json.loads(ROOM.model_dump_json())}


async def test_echo_says_what_it_waits_for_and_who_is_missing(site: Site) -> None:
    async with site.command("topic", "echo", "users/anna/ray") as process:
        told = await next_line(process.stderr)
        assert told.startswith("waiting: nothing on users/anna/ray for 2 s; no writer is present")
        assert "`pointit service run pointing --user anna`" in told
        assert (await interrupt(process))[0] == 0
    site.start(Pointing, "anna")
    await site.arrived("pointing.anna")
    async with site.command("topic", "echo", "users/anna/ray") as process:
        assert "pointing.anna can write it and runs" in await next_line(process.stderr)
        site.feed_imu("anna")
        assert (await next_line(process.stdout)).startswith("users/anna/ray: {")


async def test_a_reader_that_has_enough_ends_echo_quietly(site: Site) -> None:
    site.feed_imu("anna")
    echo = shlex.join(
        [sys.executable, "-m", "pointit", "topic", "echo", "users/anna/imu", "--connect", site.endpoint]
    )
    pipeline = await asyncio.create_subprocess_exec(
        "bash",
        *("-o", "pipefail", "-c", f"{echo} | head -n 1"),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    async with asyncio.timeout(60):
        out, err = await pipeline.communicate()
    assert out.startswith(b"users/anna/imu: ")
    assert (pipeline.returncode, out.count(b"\n"), err) == (0, 1, b"")


@pytest.mark.parametrize(
    "arguments", [("topic", "echo", "users/anna/imu"), ("topic", "hz", "users/anna/imu", "--watch")]
)
async def test_ctrl_c_ends_it_at_once(site: Site, arguments: tuple[str, ...]) -> None:
    site.feed_imu("anna")
    async with site.command(*arguments, *(("--window", "0.2") if "hz" in arguments else ())) as process:
        assert await next_line(process.stdout)
        code, took_s = await interrupt(process)
        assert code == 0
        assert within(took_s, 5.0)
        noted = (await there(process.stderr).read()).decode().splitlines()
        assert [line for line in noted if "rates are too low" not in line] == [], "some are left out"


async def test_nobody_answers(site: Site) -> None:
    await site.stop()
    ended = await site.pointit("topic", "echo", "map", code=1, progress=True)
    assert ended.err.startswith(f"looking for site lab at {site.endpoint} …\nError: nobody answers at ")
    assert (ended.err.count("\n"), ended.out) == (2, "")


async def test_a_wrong_key_does_not_even_connect(site: Site) -> None:
    ended = await site.pointit("topic", "echo", "users/anna/imuu", code=2)
    assert "did you mean users/anna/imu" in ended.err
    assert ended.err.count("\n") == 1
    assert (await site.pointit("topic", "hz")).code == 2


async def test_hz_measures_against_the_nominal_rate(site: Site) -> None:
    site.feed_imu("anna", rate_hz=100)
    began_s = time.monotonic()
    ended = await site.pointit("topic", "hz", "users/*/imu", "map", "--window", "2", "--json")
    assert time.monotonic() - began_s > 2
    assert ended.code == 0
    window = json.loads(ended.out)
    assert window["window_s"] == 2
    silent, rate = window["keys"]
    assert (silent["key"], silent["messages"], silent["rate_hz"]) == ("map", 0, None)
    assert (rate["key"], rate["nominal_hz"]) == ("users/anna/imu", 50)
    assert 5 < rate["rate_hz"] < 150  # a busy machine holds some up, which then come at once
    assert rate["period_min_s"] <= 1 / rate["rate_hz"] <= rate["period_max_s"]
    assert rate["bytes_per_s"] == pytest.approx(rate["messages"] / 2 * 184, rel=0.2)


async def test_hz_of_all_shows_what_came(site: Site) -> None:
    rays: list[models.PointingRay] = []
    site.bus.subscribe(RAY, lambda ray, _user: rays.append(ray))
    site.feed_imu("anna")
    site.start(Pointing, "anna")
    await until(lambda: bool(rays), what="rays")
    ended = await site.pointit("topic", "hz", "--all", "--window", "4", code=0)
    keys = [line.split()[0] for line in ended.out.splitlines() if "/" in line and "rate hz" not in line]
    assert keys == ["configuration/pointing.anna", "health/pointing.anna", "users/anna/imu", "users/anna/ray"]


AHEAD_NS = 200_000_000
LIGHT_S = 0.25
REPORT_S = 0.1


def report(instance: str, host: str, key: str, ahead_ns: int = 0) -> models.Health:
    return models.Health(
        stamp_ns=time.time_ns() + ahead_ns, service=instance.partition(".")[0], instance=instance, pid=1,
        host=host, keys=(models.KeyHealth(key=key, direction="out", rate_hz=50.0),),
    )  # fmt: skip


@pytest_asyncio.fixture
async def elsewhere(site: Site) -> AsyncIterator[ZenohBus]:
    """Another process, on a machine whose clock is ahead: a pui of its own, and led-driver."""
    bus = await ZenohBus.open(Link(connect=(site.endpoint,)))
    cursors = bus.publisher(CURSOR, "anna")
    frames = bus.publisher(STRIPS_FRAME)

    def on_ray(ray: models.PointingRay, _user: str) -> None:
        cursors.put(models.Cursor(stamp_ns=ray.stamp_ns, seq=ray.seq))
        cursors.put(models.Cursor(stamp_ns=ray.stamp_ns, seq=ray.seq))  # two writers for a moment
        if ray.seq % 2 == 0:
            frames.put(models.StripsFrame(stamp_ns=ray.stamp_ns, strips=(), light_s=LIGHT_S))
        frames.put(models.StripsFrame(stamp_ns=ray.stamp_ns + 1, strips=()))  # of other people

    bus.subscribe(RAY, on_ray, "anna")
    here = site.bus.publisher(HEALTH, "pui")
    there = [bus.publisher(HEALTH, name) for name in ("pui.hall", "led-driver")]

    async def tell() -> None:
        while True:
            here.put(report("pui", "here", CURSOR.key))
            there[0].put(report("pui.hall", "elsewhere", CURSOR.key, AHEAD_NS))
            there[1].put(report("led-driver", "elsewhere", STRIPS_FRAME.key, AHEAD_NS))
            await asyncio.sleep(REPORT_S)

    telling = asyncio.create_task(tell())
    try:
        yield bus
    finally:
        telling.cancel()
        await bus.close()


async def pointing(site: Site) -> None:
    """Start anna's wrist and pointing, and return when rays come: pointing waits for a profile first."""
    rays: list[models.PointingRay] = []
    reading = site.bus.subscribe(RAY, lambda ray, _user: rays.append(ray), "anna")
    site.start(Pointing, "anna")
    site.feed_imu("anna")
    await until(lambda: bool(rays), PATIENCE_S, "rays")
    reading.close()


async def test_the_way_of_a_sample_over_two_machines(site: Site, elsewhere: ZenohBus) -> None:
    assert elsewhere.connected
    site.feed_imu("ben")
    await pointing(site)
    ended = await site.pointit("trace", "anna", "--count", "60", "--json")
    assert (ended.code, ended.err) == (0, "")

    trace = json.loads(ended.out)
    assert (trace["user"], trace["samples"]) == ("anna", 60)
    way = {hop["hop"]: hop for hop in trace["path"]}
    assert (list(way), way["ray"]["service"]) == (["imu", "ray", "cursor", "frame", "light"], "pointing.anna")
    assert (way["cursor"]["service"], way["cursor"]["host"]) == ("pui.hall", "elsewhere")
    assert (way["frame"]["service"], way["frame"]["host"]) == ("led-driver", "elsewhere")

    totals_s = [hop["total_s"] for hop in way.values()]
    assert totals_s == sorted(totals_s)
    assert totals_s[0] > 0
    assert abs(way["light"]["delta_s"] - LIGHT_S) < 1e-6

    reached = {hop["hop"]: hop["samples"] for hop in trace["hops"]}
    assert reached["imu"] == 60
    assert 0 < reached["frame"] < 60
    assert all(hop["delta_p50_s"] <= hop["delta_p99_s"] for hop in trace["hops"])

    (clock,) = trace["clocks"]
    assert clock.startswith("the clock of machine elsewhere is ")
    assert "ahead of" in clock


async def test_a_person_who_is_not_there_is_one_sentence(site: Site) -> None:
    site.start(Pointing, "anna")
    await site.arrived("pointing.anna")
    ended = await site.pointit("trace", "ana", code=1)
    assert "no sample of ana came within 3 s: no writer is present" in ended.sentence
    assert "did you mean anna" in ended.sentence
    ended = await site.pointit("trace", "users/anna")
    assert ended.code != 0
    assert ended.took_s < 60
    assert "users/anna" in ended.sentence


async def test_samples_that_end_are_shown_with_a_note(site: Site) -> None:
    feed = site.feed_imu("anna")
    async with site.command("trace", "anna", "--watch", "--count", "200", "--json") as process:
        assert json.loads(await next_line(process.stdout))["samples"] == 200
        feed.cancel()  # samples that have not settled belong to the next measurement
        assert 0 < json.loads(await next_line(process.stdout))["samples"] < 200
        assert "of 200 samples came, then none for 3 s" in await next_line(process.stderr)
