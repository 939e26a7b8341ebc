"""`pointit topic echo` and `pointit topic hz` against a real bus, in processes of their own."""

import asyncio
import json
import shlex
import sys
import time

import pytest
import yaml

from pointit.schemas import Environment, PointingRay, Strip, UserProfile
from pointit.schemas.topics import MAP, PROFILE, RAY
from pointit.services.pointing.service import Pointing
from tests.support import there
from tests.support.bench import until
from tests.support.cli_site import Site, interrupt, next_line

ROOM = Environment(
    stamp_ns=1, name="room", strips=(Strip(id="left", line_m=((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), pixels=30),)
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


async def test_echo_of_one_person_is_theirs_alone(site: Site) -> None:
    site.feed_imu("anna")
    site.feed_imu("ben")
    ended = await site.pointit("topic", "echo", "users/anna/imu", "--count", "10", "--json")
    messages = [json.loads(line) for line in ended.out.splitlines()]
    assert [message["key"] for message in messages] == ["users/anna/imu"] * 10
    numbers = [message["seq"] for message in messages]
    assert numbers == sorted(set(numbers))


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


async def test_echo_does_not_nag_about_what_comes_on_change(site: Site) -> None:
    site.bus.publisher(PROFILE, "anna").put(UserProfile(stamp_ns=1))
    async with site.command("topic", "echo", "users/anna/profile") as process:
        assert (await next_line(process.stdout)).startswith("users/anna/profile: {")
        await asyncio.sleep(2.5)  # longer than its patience
        await interrupt(process)
        assert await there(process.stderr).read() == b""


async def test_a_reader_that_has_enough_ends_echo_quietly(site: Site) -> None:
    site.feed_imu("anna")
    echo = shlex.join(
        [sys.executable, "-m", "pointit.cli", "topic", "echo", "users/anna/imu", "--connect", site.endpoint]
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
        assert took_s < 5
        noted = (await there(process.stderr).read()).decode().splitlines()
        assert [line for line in noted if "rates are too low" not in line] == [], (
            "a busy machine leaves some out"
        )


async def test_nobody_answers(site: Site) -> None:
    await site.stop()
    ended = await site.pointit("topic", "echo", "map", code=1)
    assert ended.err.startswith(f"looking for site lab at {site.endpoint} …\nError: nobody answers at ")
    assert (ended.err.count("\n"), ended.out) == (2, "")


async def test_a_wrong_key_does_not_even_connect(site: Site) -> None:
    ended = await site.pointit("topic", "echo", "users/anna/imuu", code=2)
    assert "did you mean users/anna/imu" in ended.err
    assert ended.err.count("\n") == 1
    assert (await site.pointit("topic", "hz")).code == 2


async def test_other_sites_are_not_heard(site: Site) -> None:
    site.feed_imu("anna")
    ended = await site.pointit(
        "topic", "hz", "users/anna/imu", "--window", "0.5", "--json", "--site", "elsewhere", code=1
    )
    assert json.loads(ended.out)["keys"][0]["messages"] == 0


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
    rays: list[PointingRay] = []
    site.bus.subscribe(RAY, lambda ray, _user: rays.append(ray))
    site.feed_imu("anna")
    site.start(Pointing, "anna")
    await until(lambda: bool(rays), what="rays")
    ended = await site.pointit("topic", "hz", "--all", "--window", "4", code=0)
    keys = [line.split()[0] for line in ended.out.splitlines() if "/" in line and "rate hz" not in line]
    assert keys == ["configuration/pointing.anna", "health/pointing.anna", "users/anna/imu", "users/anna/ray"]
