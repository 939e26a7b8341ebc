"""Whole sites in this process, in virtual time."""

import asyncio
import math
import sys
import threading
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

import pointit
from pointit.errors import (
    BusClosedError,
    ConfigError,
    NoMessageError,
    PointItError,
    RefusedError,
    SchemaError,
)
from pointit.schemas import TrackedObject
from pointit.schemas.topics import POSE, ROBOT_STATE
from pointit.services.led_driver.service import LedDriver
from tests.support.commands import Commands


async def pointed(seed: int) -> list[tuple[int, float]]:
    async with pointit.run("scenario_2", seed=seed) as site:
        return [(cursor.stamp_ns, cursor.position_m) async for cursor in site.cursors().during(3)]


def test_the_same_seed_gives_the_same_run(own_state: Path) -> None:
    first, again, other = (pointit.run_virtually(pointed(seed)) for seed in (1, 1, 2))
    assert first == again != other
    assert len(first) > 100
    assert not own_state.exists()  # nothing is stored


SCRIPT = """
import pointit
with pointit.run("shelf", virtual=True) as site:

    @site.on_pointed()
    def order(event):
        print(f"{event.user} wants {event.thing}", flush=True)

    site.wait()
print("closed")
"""


async def test_waiting_script_reacts_until_ctrl_c_and_then_goes_on(
    tmp_path: Path, commands: Commands
) -> None:
    (tmp_path / "model.py").write_text(SCRIPT)
    script = commands.run([sys.executable, str(tmp_path / "model.py")])
    await script.says("user1 wants ")
    ended = await script.stop(code=0)
    assert ended.out.endswith("closed\n")
    assert "Traceback" not in ended.err


def test_a_script_sees_people_point_and_sends_requests() -> None:
    with pointit.run("scenario_3", users=2, virtual=True) as site:
        names = {name for name in dir(site._site) if not name.startswith("_")}
        assert set(dir(site)) > names - {"fail", "on"}  # the same names as in `Site`
        assert next(site.people()) == {"user1", "user2"}
        assert {"pui", "selector", "pointing.user1"} <= next(site.services())

        began_ns = site.now_ns()
        assert site.now_ns() == began_ns  # no time passes between calls
        events = site.selections()
        site.sleep(10)
        assert site.now_ns() - began_ns == 10_000_000_000

        found = [event for event in events.during(0) if event.event == "selected"]
        assert found
        assert {user for user, _ in site.cursors().items().during(0.1)} == {"user1", "user2"}

        selected = {each.id for each in site.latest.selection.value.objects}
        assert set() < selected <= {event.object_id for event in found}
        assert "deselected" in site.select.undo(found[-1].user).message
        assert site.select.method(dwell_s=0.5).dwell_s == 0.5
        assert site.select.method("hold").name == "hold"
        assert site.latest.cursor["user1"].stamp_ns > began_ns
        with pytest.raises(NoMessageError, match="nothing came on users/nobody/cursor within 2 s"):
            _ = site.latest.cursor["nobody"]

        waited_ns = site.now_ns()
        assert site.latest.cursor.get("nobody") is None
        assert "nobody" not in site.latest.cursor
        assert set(site.latest.cursor) == {"user1", "user2"}
        assert site.now_ns() == waited_ns
        assert site.latest.pose.wait("user1", timeout_s=5.0).stamp_ns > 0
        with pytest.raises(RefusedError, match="nothing to take back"):
            site.select.undo("nobody")
        with pytest.raises(SchemaError, match="brightness: must be at most 1"):
            site.leds.brightness(7)
        assert site.press("user1").state == "idle"
    with pytest.raises(BusClosedError, match="the site is closed"):
        site.cursors()
    site.close()


def test_objects_and_lamps_of_a_script() -> None:
    with pointit.run("scenario_1", users=0, virtual=True) as site:
        things = site.objects("camera")
        tracker = site.tracker("camera")
        tracker.update([TrackedObject(id="cup", kind="red", position_m=(1.0, 2.0, 0.8))])
        assert [thing.id for thing in next(things).objects] == ["cup"]

        tracker.close()
        assert next(things).objects == ()
        with pytest.raises(BusClosedError):
            tracker.update([])

        lamp = site.lamp(site.latest.map.value.lamps[0].id)
        colors = lamp.colors()
        assert next(colors).color == (0, 0, 0)
        assert lamp.set("#ff8800").message == f"lamp {lamp.name} shows #ff8800"
        assert next(colors).color == (255, 136, 0)

        lamp.set(None)
        assert next(colors).color == (0, 0, 0)
        with pytest.raises(RefusedError, match="there is no lamp 'door'; there are"):
            site.lamp("door").set((1, 2, 3))
        with pytest.raises(SchemaError, match="'red' is no colour: write one like '#ff8800'"):
            lamp.set("red")


def test_loop_exception_reaches_the_caller_and_ends_the_site() -> None:
    def fail() -> None:
        with pointit.run("scenario_2", virtual=True) as site:
            for _cursor in site.cursors():
                raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert "pointit" not in {thread.name for thread in threading.enumerate()}


async def fails(_service: Any) -> None:
    raise ValueError("no light")


async def waits(site: pointit.Site) -> None:
    await anext(site.selections())


async def leaves(_site: pointit.Site) -> None:
    await asyncio.sleep(1.0)


@pytest.mark.parametrize("act", [waits, leaves])
def test_a_service_that_fails_is_named_to_who(
    act: Callable[[pointit.Site], Awaitable[object]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LedDriver, "run", fails)

    async def wait() -> None:
        async with pointit.run("scenario_2") as site:
            await act(site)

    with pytest.raises(PointItError, match=r"a service of the site has failed \(ValueError: no light\)"):
        pointit.run_virtually(wait())


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"scenario": "scenario_9"}, "no scenario 'scenario_9'"),
        ({"settings": {"nothing.at_all": 1}}, "'nothing' is no service"),
        ({"settings": {"selector.dwell_s": object()}}, "settings: selector.dwell_s cannot be <object"),
        ({"users": ["an na"]}, "use 1 to 64 letters"),
        ({"listen": "tcp/127.0.0.1:7447"}, "nobody can join a site in virtual time"),
    ],
)
def test_run_that_cannot_start_gives_one_sentence(arguments: dict[str, Any], sentence: str) -> None:
    with pytest.raises(PointItError, match=sentence), pointit.run(**arguments, virtual=True):
        pass


async def test_virtual_time_needs_a_loop_of_its_own() -> None:
    with pytest.raises(ConfigError, match=r"run this coroutine by `pointit\.run_virtually"):
        async with pointit.run("scenario_2", virtual=True):
            pass


def test_virtual_time_neither_joins_nor_waits_for_others() -> None:
    async def join() -> None:
        async with pointit.connect():
            pass

    with pytest.raises(ConfigError, match="cannot be joined in virtual time"):
        pointit.run_virtually(join())
    with pytest.raises(RuntimeError, match="everything waits for something that will never happen"):
        pointit.run_virtually(asyncio.Event().wait())


SCENARIO = """
about: a robot that people follow
places: [{position_m: [3.0, 0.4, 0.0], yaw_deg: 20.0}]
site:
  pui: {map: lab, workspace: horizontal}
  robot.quad: {kind: quadrotor, start_m: [2.2, 2.8, 0.0], radius_m: 0.15}
user:
  pointing: {}
  localizer: {}
  supervisor: {}
  user-sim: {think_s: 0.0, behaviour: rest}
"""


def test_follower_of_a_quadrotor_is_located_within_the_stated_sigma(tmp_path: Path) -> None:
    path = tmp_path / "robots.yaml"
    path.write_text(SCENARIO, encoding="utf-8")
    with pointit.run(path, localize="robot", virtual=True) as site:
        pose = next(site.messages(POSE, "user1").during(40.0))
        x_m, y_m, _ = pose.position_m
        sigma_m = math.sqrt(max(pose.covariance[0], pose.covariance[4]))
        assert pose.method == "moving_target"
        assert 0.05 < sigma_m < 0.8
        assert math.dist((x_m, y_m), (3.0, 0.4)) < min(2.5 * sigma_m, 0.5)
        landed = (state for state in site.messages(ROBOT_STATE, "quad") if state.phase == "landed")
        assert math.dist(next(landed).position_m[:2], (3.0, 0.4)) > 1.0
