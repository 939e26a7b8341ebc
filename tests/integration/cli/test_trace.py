"""`pointit trace` against a real bus, in a process of its own."""

import asyncio
import json
import time
from collections.abc import AsyncIterator

import pytest_asyncio

from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Cursor, Health, KeyHealth, PointingRay, StripsFrame
from pointit.schemas.topics import CURSOR, HEALTH, RAY, STRIPS_FRAME
from pointit.services.pointing.service import Pointing
from tests.support.bench import until
from tests.support.cli_site import Site, interrupt, next_line
from tests.support.commands import PATIENCE_S

AHEAD_NS = 200_000_000
LIGHT_S = 0.25
REPORT_S = 0.1


def report(instance: str, host: str, key: str, ahead_ns: int = 0) -> Health:
    return Health(
        stamp_ns=time.time_ns() + ahead_ns,
        service=instance.partition(".")[0],
        instance=instance,
        pid=1,
        host=host,
        keys=(KeyHealth(key=key, direction="out", rate_hz=50.0),),
    )


@pytest_asyncio.fixture
async def elsewhere(site: Site) -> AsyncIterator[ZenohBus]:
    """Another process, on a machine whose clock is ahead: a pui of its own, and led-driver."""
    bus = await ZenohBus.open(Link(connect=(site.endpoint,)))
    cursors, frames = bus.publisher(CURSOR, "anna"), bus.publisher(STRIPS_FRAME)

    def on_ray(ray: PointingRay, _user: str) -> None:
        cursors.put(Cursor(stamp_ns=ray.stamp_ns, seq=ray.seq))
        cursors.put(Cursor(stamp_ns=ray.stamp_ns, seq=ray.seq))  # two writers for a moment
        if ray.seq % 2 == 0:
            frames.put(StripsFrame(stamp_ns=ray.stamp_ns, strips=(), light_s=LIGHT_S))
        frames.put(StripsFrame(stamp_ns=ray.stamp_ns + 1, strips=()))  # of other people

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
    rays: list[PointingRay] = []
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


async def test_tables_are_for_people(site: Site) -> None:
    await pointing(site)
    ended = await site.pointit("trace", "anna", "--count", "20")
    assert (ended.code, ended.err) == (0, "")
    assert "Sample: of anna, captured at " in ended.out
    assert "Hops: 20 samples" in ended.out
    rows = [line.split() for line in ended.out.splitlines() if line.startswith((" imu ", " ray "))]
    assert [row[0] for row in rows] == ["imu", "ray"] * 2, ended.out
    assert rows[1][1] == "pointing.anna"


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


async def test_ctrl_c_ends_it_at_once(site: Site) -> None:
    site.feed_imu("anna")
    async with site.command("trace", "anna", "--watch", "--count", "5", "--json") as process:
        assert json.loads(await next_line(process.stdout))["samples"] == 5
        assert json.loads(await next_line(process.stdout))["samples"] == 5
        code, took_s = await interrupt(process)
    assert code == 0
    assert took_s < 5


async def test_samples_that_end_are_shown_with_a_note(site: Site) -> None:
    feed = site.feed_imu("anna")
    async with site.command("trace", "anna", "--watch", "--count", "200", "--json") as process:
        assert json.loads(await next_line(process.stdout))["samples"] == 200
        feed.cancel()  # samples that have not settled belong to the next measurement
        assert 0 < json.loads(await next_line(process.stdout))["samples"] < 200
        assert "of 200 samples came, then none for 3 s" in await next_line(process.stderr)
