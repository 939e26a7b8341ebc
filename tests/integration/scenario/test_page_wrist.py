"""Somebody takes a simulated person's wrist with a page: real services on a bus in memory, virtual time.

The page is scripted: thirty times a second it turns the arm so that the ray meets a place, by the pose.
"""

import asyncio
import math
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from typing import Any, Literal

import pytest

import pointit.schemas as models
from pointit.geometry import rotation
from pointit.geometry.vector import Vec3
from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.plan import read_scenario
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.clock import START_NS, VirtualClock
from pointit.runtime.service.service import Launch
from pointit.schemas.topics import BUTTON, CURSOR, IMU, INTERACTION, OBJECTS, POSE, SELECTION_EVENTS, WRIST
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.service import ImuBridge
from pointit.sim.aim import Stance
from tests.integration.scenario.play import running, with_fresh_state

USER = "anna"
PAGE_HZ = 30.0
UNKNOWN_RAD = math.radians(30.0)
"""A yaw of a sigma above this is none."""


@dataclass
class Seen:
    """Messages on the bus. Times are seconds since the start."""

    samples: list[models.ImuSample] = field(default_factory=list[models.ImuSample])
    cursors: list[models.Cursor] = field(default_factory=list[models.Cursor])
    wanted_m: dict[int, Vec3] = field(default_factory=dict[int, Vec3])
    """Points at which the page pointed in {W}, m, by the stamp of its sample."""
    presses: list[models.ButtonEvent] = field(default_factory=list[models.ButtonEvent])
    events: list[models.SelectionEvent] = field(default_factory=list[models.SelectionEvent])
    states: list[str] = field(default_factory=list[str])
    things: dict[str, models.TrackedObject] = field(default_factory=dict[str, models.TrackedObject])
    pose: models.UserPose | None = None

    @property
    def yaw_sigma_rad(self) -> float:
        assert self.pose is not None
        return math.sqrt(self.pose.covariance[8])

    def selected(self, since: int = 0) -> list[str]:
        """Return the objects selected from event number `since` on."""
        return [event.object_id for event in self.events[since:] if event.event == "selected"]

    def beside_m(self, from_s: float, till_s: float) -> list[float]:
        """Return the distances of the page's cursors in that time from the points it pointed at, m."""
        return [
            math.inf if cursor.point_m is None else math.dist(cursor.point_m, self.wanted_m[cursor.stamp_ns])
            for cursor in self.cursors
            if from_s <= since_start_s(cursor.stamp_ns) <= till_s and cursor.stamp_ns in self.wanted_m
        ]

    def own(self, from_s: float, till_s: float = math.inf) -> list[models.ImuSample]:
        """Return the samples of that time that are not the page's."""
        return [
            sample
            for sample in self.samples
            if from_s <= since_start_s(sample.stamp_ns) <= till_s and sample.stamp_ns not in self.wanted_m
        ]


def since_start_s(stamp_ns: int) -> float:
    return (stamp_ns - START_NS) / models.NS_PER_S


class Site:
    """A running scenario of one simulated person, and a page beside it."""

    def __init__(self, bus: MemoryBus, clock: VirtualClock) -> None:
        self.bus, self.clock, self.seen = bus, clock, Seen()
        self._wrist = bus.publisher(WRIST, USER)
        self._button = bus.publisher(BUTTON, USER)
        self._count = 0
        seen = self.seen
        bus.subscribe(IMU, lambda sample, _name: seen.samples.append(sample), USER)
        bus.subscribe(CURSOR, lambda cursor, _name: seen.cursors.append(cursor), USER)
        bus.subscribe(BUTTON, lambda press, _name: seen.presses.append(press), USER)
        bus.subscribe(SELECTION_EVENTS, lambda event, _name: seen.events.append(event))
        bus.subscribe(INTERACTION, lambda news, _name: seen.states.append(news.state), USER)
        bus.subscribe(OBJECTS, self._on_objects)
        bus.subscribe(POSE, self._on_pose, USER)

    @property
    def yaw_known(self) -> bool:
        return self.seen.pose is not None and self.seen.yaw_sigma_rad < UNKNOWN_RAD

    @property
    def now_s(self) -> float:
        return since_start_s(self.clock.now_ns())

    async def until(self, condition: Callable[[], bool], within_s: float, what: str) -> float:
        """Wait for `condition`; return how long it took, s."""
        began_s = self.now_s
        while not condition():
            assert self.now_s - began_s < within_s, f"{what} took more than {within_s} s"
            await asyncio.sleep(0.02)
        return self.now_s - began_s

    async def point(
        self,
        duration_s: float,
        at: Callable[[float], Vec3],
        *,
        device: Literal["arm", "phone"] = "arm",
        until: Callable[[], bool] = lambda: False,
    ) -> None:
        """Have the page point at a place of the time, s, for a while or `until`."""
        end_s = self.now_s + duration_s
        while self.now_s < end_s and not until():
            pose, place_m = self.seen.pose, at(self.now_s)
            assert pose is not None
            stance = Stance(models.BodyMeasures(), position_m=pose.position_m)
            azimuth, elevation = stance.aim_at(place_m, (0.0, pose.elevation_bias_rad))
            self._count += 1
            sample = models.WristSample(
                stamp_ns=self.clock.now_ns(),
                seq=self._count,
                orientation_xyzw=rotation.from_azimuth_elevation(azimuth - pose.yaw_rad, elevation),
                device=device,
                device_time_ns=self.clock.now_ns() - START_NS,
            )
            self.seen.wanted_m[sample.stamp_ns] = place_m
            self._wrist.put(sample)
            await asyncio.sleep(1.0 / PAGE_HZ)

    def press(self, gesture: Literal["press", "double", "hold"] = "press") -> None:
        self._count += 1
        self._button.put(
            models.ButtonEvent(stamp_ns=self.clock.now_ns(), seq=self._count, source="page", gesture=gesture)
        )

    def _on_objects(self, objects: models.TrackedObjects, _name: str) -> None:
        self.seen.things = {thing.id: thing for thing in objects.objects}

    def _on_pose(self, pose: models.UserPose, _name: str) -> None:
        self.seen.pose = pose


Script = Callable[[Site], Coroutine[Any, Any, None]]


def run(script: Script, scenario: str = "scenario_3", choices: Choices | None = None) -> Seen:
    return with_fresh_state(_run(script, scenario, choices or Choices(seed=1)))


async def _run(script: Script, scenario: str, choices: Choices) -> Seen:
    plan = read_scenario(scenario)
    launches = [*site_launches(plan, choices), *user_launches(plan, choices, USER)]
    if ImuBridge not in {launch.service for launch in launches}:
        launches.append(Launch(service=ImuBridge, config=ImuBridgeConfig(source="page"), user=USER))
    bus, clock = MemoryBus(LocalBroker()), VirtualClock()
    site = Site(bus, clock)
    async with running(launches, bus, clock) as services:
        pages = asyncio.create_task(script(site))
        await asyncio.wait({services, pages}, return_when=asyncio.FIRST_COMPLETED)
        if pages.done():
            pages.result()
        pages.cancel()
    return site.seen


def along_the_strip(time_s: float) -> Vec3:
    """Return a place that goes up and down strip 0 at 0.5 m/s at most."""
    return (4.85, 1.0 + 2.0 * math.sin(time_s / 4.0), 0.9)


def following(site: Site, name: str) -> Callable[[float], Vec3]:
    return lambda _time_s: site.seen.things[name].position_m


def free_red(site: Site) -> str:
    """Return a red segment that nobody has selected, with way to go."""
    done = {event.object_id for event in site.seen.events}
    things = [
        thing
        for thing in site.seen.things.values()
        if thing.kind == "red" and thing.id not in done and 0.5 < thing.surface_position_m < 3.0
    ]
    return min(things, key=lambda thing: thing.surface_position_m).id


@pytest.mark.slow
def test_the_page_moves_the_cursor_and_selects_while_the_person_is_silent_who_then_goes_on() -> None:
    times_s: list[float] = []
    took_s: list[float] = []
    chosen: list[str] = []

    async def script(site: Site) -> None:
        await asyncio.sleep(10.0)
        times_s.append(site.now_s)
        await site.point(6.0, along_the_strip)
        times_s.append(site.now_s)
        await site.point(2.0, lambda _: (4.85, 2.0, 0.9))
        times_s.append(site.now_s)
        name = free_red(site)
        chosen.append(name)
        await site.point(5.0, following(site, name), until=lambda: name in site.seen.selected())
        times_s.append(site.now_s)
        done = len(site.seen.events)
        took_s.append(await site.until(lambda: bool(site.seen.own(times_s[-1])), 3.0, "to be heard again"))
        took_s.append(await site.until(lambda: bool(site.seen.selected(done)), 8.0, "to select again"))
        await asyncio.sleep(10.0)

    seen = run(script)
    began_s, swept_s, held_s, end_s = times_s
    assert seen.own(2.0, began_s - 0.1)
    assert seen.own(began_s + 0.05, end_s + 0.95) == []  # the person and their band
    assert 0.95 <= took_s[0] <= 1.1
    assert took_s[1] < 8.0
    beside_m = seen.beside_m(began_s, end_s)
    assert len(beside_m) > 0.9 * len(seen.wanted_m)  # the samples of the page go the whole way
    assert max(seen.beside_m(began_s + 0.5, swept_s - 0.01)) < 0.25  # what smoothing lags behind, at 0.5 m/s
    assert max(seen.beside_m(swept_s + 1.0, held_s - 0.01)) < 0.01
    of_chosen = [one for one in seen.events if one.object_id == chosen[0] and one.event != "left"]
    assert [(one.event, one.user) for one in of_chosen] == [("selected", USER)]
    assert {event.kind for event in seen.events if event.event == "selected"} == {"red"}
    assert [press.source for press in seen.presses] == ["simulated"]  # once, to begin with
    assert seen.states[-1] == "pointing"


@pytest.mark.parametrize("device", ["arm", "phone"])
def test_a_mouse_keeps_the_pose_that_pointing_has_told_and_a_phone_has_another_yaw(
    device: Literal["arm", "phone"],
) -> None:
    sigmas: list[float] = []

    async def script(site: Site) -> None:
        await site.until(lambda: site.yaw_known, 60.0, "to be found")
        await asyncio.sleep(3.0)
        sigmas.append(site.seen.yaw_sigma_rad)
        await site.point(5.0, along_the_strip, device=device)
        sigmas.append(site.seen.yaw_sigma_rad)
        await asyncio.sleep(4.0)
        sigmas.append(site.seen.yaw_sigma_rad)

    seen = run(script, "scenario_2", Choices(seed=3, localize=True))
    before, during, after = sigmas
    assert before < UNKNOWN_RAD
    if device == "arm":
        assert max(during, after) < UNKNOWN_RAD
        assert {sample.yaw_epoch for sample in seen.samples} == {0}
    else:
        assert during > UNKNOWN_RAD
