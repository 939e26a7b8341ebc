"""A run with a device without a button begins by itself; `pointit person press` stops and starts it."""

import json

from tests.support.bench import until
from tests.support.commands import Commands, onlooker, summary_of


async def test_a_device_without_a_button_shows_a_cursor_and_the_run_ends_well(
    commands: Commands, endpoint: str
) -> None:
    run = commands.start(
        *("run", "scenario_2", "--imu", "simulated", "--duration", "600", "--no-view", "--json"),
        *("--listen", endpoint),
    )
    async with onlooker(endpoint) as seen:
        await until(lambda: seen.surfaces("user1") == {"0", "1"}, 20, "its sweep crosses both strips")
        await until(lambda: len(seen.cursors["user1"]) > 150, what="many cursors")
        cursors = list(seen.cursors["user1"])
    ended = await run.stop()
    assert ended.code == 0, ended.err
    assert summary_of(ended)["cursors"] > 100
    assert sum(cursor.surface == "strip" for cursor in cursors) > len(cursors) / 2
    assert min(cursor.miss_rad for cursor in cursors if cursor.surface == "strip") < 0.01


async def test_a_press_from_the_keyboard_stops_it_until_the_next(commands: Commands, endpoint: str) -> None:
    run = commands.start(
        *("run", "scenario_2", "--imu", "simulated", "--duration", "60", "--no-view", "--listen", endpoint)
    )
    async with onlooker(endpoint) as seen:
        await seen.sees_cursors("user1")
        pressed = await commands.pointit("person", "press", "user1", "--json", "--connect", endpoint)
        assert (pressed.code, json.loads(pressed.out)["state"]) == (0, "idle"), pressed.err
        pressed = await commands.pointit("person", "press", "user1", "--connect", endpoint)
        assert pressed.code == 0
        assert pressed.out.startswith("user1: pointing. Your place in the room is known. Point with")
        told = seen.interactions["user1"]
        await until(lambda: [each.state for each in told][-2:] == ["idle", "pointing"], what="both to come")
        await seen.sees_cursors("user1")
    assert (await run.stop()).code == 0
