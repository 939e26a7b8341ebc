"""Acts of others in golden and replayed sessions: they ask, press, walk, and track things with a camera."""

import asyncio
import contextlib
import math
from pathlib import Path
from typing import Any, Literal

import pointit.schemas as models
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.errors import RequestError
from pointit.runtime.virtual_time import START_NS, VirtualClock
from pointit.schemas import topics

ROOM = Path(__file__).with_name("room.yaml").read_text("utf-8")
"""A strip with a bend, partly behind opaque things, before a wall."""

OFFSET = models.PointingOffset(
    rung="polynomial", azimuth=(0.02, 0.05, -0.02, 0.01, 0.03, 0.0),
    elevation=(-0.06, 0.02, 0.04, -0.03, 0.01, 0.02), reference_rad=0.4, azimuth_range_rad=(-0.5, 0.6),
    elevation_range_rad=(-0.6, 0.1), sigma_rad=0.02, anchors=6,
)  # fmt: skip


THINGS = """
lamps: {radio: {position: [2.2, -1.9, 1.1]}, kettle: {position: [2.4, -1.0, 1.25]}}
strips: {shelf: {line: [[2.4, 1.4, 1.25], [2.4, -1.4, 1.25]], pixels: 84}}
things:
  screws: {center: [2.6, 1.0, 1.4], size: [0.4, 0.4, 0.3], light: {strip: shelf, from: 0.2, to: 0.6}}
  crate: {center: [2.6, 0, 1.4], size: [0.4, 0.4, .3], mode: claim, light: {strip: shelf, from: 1.2, to: 1.6}}
  kettle: {center: [2.6, -1.0, 1.4], size: [0.4, 0.4, 0.3], light: kettle, press: true}
  radio: {light: radio, mode: switch}
  cart: {at: object, mode: switch}
"""
"""A thing of each mode, one that wants a press, and one that a camera tracks."""


class _Desk:
    """Place of those others, who know the time of the session and what is selected."""

    def __init__(self, bus: MemoryBus) -> None:
        self.bus = bus
        self.selection = models.Selection(stamp_ns=0)
        bus.subscribe(topics.SELECTION, self._on_selection)

    def _on_selection(self, selection: models.Selection, _name: str) -> None:
        self.selection = selection

    async def at(self, time_s: float) -> None:
        """Wait until that time of the session."""
        now_s = (VirtualClock().now_ns() - START_NS) / models.NS_PER_S
        await asyncio.sleep(time_s - now_s)

    async def ask(self, request: topics.Request[Any, Any], query: models.Query, name: str = "") -> None:
        """Ask, and take a refusal like a reply."""
        with contextlib.suppress(RequestError):
            await self.bus.call(request, query, name)

    def press(self, user: str, gesture: Literal["press", "double", "hold"] = "press") -> None:
        event = models.ButtonEvent(stamp_ns=VirtualClock().now_ns(), gesture=gesture, source="page")
        self.bus.publisher(topics.BUTTON, user).put(event)

    async def until_selected(self, user: str, before_s: float) -> str:
        """Return an object of `user` as soon as there is one, or `""`."""
        while (VirtualClock().now_ns() - START_NS) / models.NS_PER_S < before_s:
            own_ids = [item.id for item in self.selection.objects if item.user == user]
            if own_ids:
                return own_ids[-1]
            await asyncio.sleep(0.1)
        return ""


async def calibrates(bus: MemoryBus) -> None:
    """An offset is kept, the pose anchored and corrected, the localization begun again, and all forgotten."""
    desk = _Desk(bus)
    await desk.at(22.0)
    await desk.ask(topics.SET_OFFSET, models.SetOffset(offset=OFFSET), "anna")
    await desk.at(28.0)
    await desk.ask(topics.POINT_ANCHOR, models.PointAnchor(lamp="led_1"), "anna")
    await desk.at(36.0)
    await desk.ask(topics.SET_HEADING, models.SetHeading(azimuth_rad=0.3), "anna")
    await desk.at(39.0)
    await desk.ask(topics.START_LOCALIZATION, models.StartLocalization(), "anna")
    await desk.at(42.0)
    await desk.ask(topics.CANCEL_LOCALIZATION, topics.CANCEL_LOCALIZATION.query(), "anna")
    await desk.ask(topics.SET_OFFSET, models.SetOffset(), "anna")
    pose = models.SetPose(position_m=(2.1, 0.4, 0.0), yaw_rad=0.4, elevation_bias_rad=0.05)
    await desk.ask(topics.SET_POSE, pose, "anna")


async def takes_back(bus: MemoryBus) -> None:
    """Selections are undone, released, taken over and cleared, for two people."""
    desk = _Desk(bus)
    await desk.until_selected("anna", 12.0)
    await desk.ask(topics.UNDO_SELECTION, models.UndoSelection(), "anna")
    await desk.ask(topics.UNDO_SELECTION, models.UndoSelection(), "anna")
    taken = await desk.until_selected("anna", 17.0)
    takeover = models.ReleaseObject(object_id=taken or "none", take_over=True)
    await desk.ask(topics.RELEASE_OBJECT, takeover, "ben")
    await asyncio.sleep(0.5)
    await desk.ask(topics.UNDO_SELECTION, models.UndoSelection(), "ben")
    released = await desk.until_selected("ben", 20.0)
    release = models.ReleaseObject(object_id=released or "none")
    await desk.ask(topics.RELEASE_OBJECT, release, "anna")
    await desk.until_selected("ben", 22.0)
    await desk.at(23.0)
    await desk.ask(topics.CLEAR_SELECTION, models.ClearSelection(), "ben")
    await desk.ask(topics.READ_HISTORY, models.ReadHistory(last=20))


async def chooses_method(bus: MemoryBus) -> None:
    """The method, its time and the tolerance are changed while the person selects."""
    desk = _Desk(bus)
    queries = (
        (7.3, models.SetMethod(method="hold", dwell_s=0.6)),
        (13.1, models.SetMethod(method="gauge", dwell_s=0.7)),
        (19.7, models.SetMethod(dwell_s=0.5)),
        (20.0, models.SetMethod(method="fraction")),
        (20.5, models.SetMethod(name="no_such_method")),
    )
    for time_s, query in queries:
        await desk.at(time_s)
        await desk.ask(topics.SET_METHOD, query)
        tolerance = models.SetTolerance(tolerance_rad=0.02 * time_s)
        await desk.ask(topics.SET_TOLERANCE, tolerance)


async def runs_belts(bus: MemoryBus) -> None:
    """Packages are added, belts stopped, turned back and emptied, the feeders halted."""
    desk = _Desk(bus)
    await desk.at(2.0)
    for kind, lane, position in (("red", "part_g", 0.3), ("blue", "part_h", 0.1), ("red", "part_h", None)):
        package = models.AddPackage(kind=kind, lane=lane, position=position, length_m=0.35)
        await desk.ask(topics.ADD_PACKAGE, package)
    await desk.at(9.0)
    await desk.ask(topics.SET_SPEED, models.SetSpeed(speed_mps=0.0, belts=("part_f", "part_h")))
    await desk.at(13.0)
    await desk.ask(topics.SET_SPEED, models.SetSpeed(speed_mps=0.8, belts=("part_h",)))
    await desk.ask(topics.SET_SPEED, models.SetSpeed(speed_mps=-0.2, belts=("part_f",)))
    await desk.at(16.0)
    await desk.ask(topics.SET_SPEED, models.SetSpeed(speed_mps=0.7))
    await desk.ask(topics.SET_FEEDING, models.SetFeeding(feeding=False))
    await desk.at(24.0)
    await desk.ask(topics.SET_FEEDING, models.SetFeeding(feeding=True))
    await desk.at(31.0)
    await desk.ask(topics.RESET_CONVEYOR, models.ResetConveyor())
    await desk.ask(topics.SET_BRIGHTNESS, models.SetBrightness(brightness=0.4, strips=("7", "9")))


async def moves_on_workspaces(bus: MemoryBus) -> None:
    """The person gets one workspace after another, through their cursor, a place and tracked objects."""
    desk = _Desk(bus)
    asked = (
        models.SetWorkspace(kind="horizontal"),
        models.SetWorkspace(kind="facing", anchor="object", object_id="red on strip"),
        models.SetWorkspace(kind="cylinder", anchor="object", object_id="red in air"),
        models.SetWorkspace(kind="sphere", anchor="point", point_m=(4.0, 2.0, 1.0)),
        models.SetWorkspace(kind="facing"),
        models.SetWorkspace(kind="cylinder", anchor="object", object_id="nothing"),
        models.SetWorkspace(kind="none"),
    )
    objects = asyncio.create_task(tracks(bus))
    for index, query in enumerate(asked):
        await desk.at(3.03 + 2.1 * index)
        await desk.ask(topics.SET_WORKSPACE, query, "anna")
    await objects


async def presses(bus: MemoryBus) -> None:
    """The person presses again and again while a camera tracks what they point at."""
    desk = _Desk(bus)
    objects = asyncio.create_task(tracks(bus))
    for tick in range(22):
        await desk.at(3.0 + 0.6 * tick)
        desk.press("anna")
    await objects


async def tries_things(bus: MemoryBus) -> None:
    """A camera tracks a cart for a while. Things are fired by a press, and without pointing, too."""
    desk = _Desk(bus)
    camera = bus.publisher(topics.OBJECTS, "camera")
    pressed: list[int] = []

    def on_hover(hover: models.Hover, user: str) -> None:
        is_full = hover.object_id == "kettle" and hover.progress == 1.0
        if is_full and not pressed:
            pressed.append(hover.stamp_ns)
            desk.press(user)

    bus.subscribe(topics.HOVER, on_hover)
    for tick in range(90):
        await desk.at(1.0 + 0.2 * tick)
        cart = models.TrackedObject(id="cart", kind="cart", position_m=(0.2, 2.6, 0.5), length_m=0.5)
        seen = models.TrackedObjects(stamp_ns=VirtualClock().now_ns(), seq=tick, objects=(cart,))
        camera.put(seen)
        if tick in (30, 60):
            await desk.ask(topics.SET_THING, models.SetThing(thing="cart"), "ben")
    for thing in ("radio", "screws", "cart"):
        await desk.ask(topics.SET_THING, models.SetThing(thing=thing), "ben")


async def tracks(bus: MemoryBus) -> None:
    """A camera tracks objects along a strip and in the air. It loses them for a while."""
    desk = _Desk(bus)
    camera = bus.publisher(topics.OBJECTS, "camera")
    for tick in range(240):
        time_s = 0.5 + 0.07 * tick
        await desk.at(time_s)
        if 120 <= tick < 150:
            continue
        along_m = 1.0 + 0.15 * time_s
        swing = 0.3 * time_s
        on_strip = models.TrackedObject(
            id="red on strip",
            kind="red",
            position_m=(4.8, along_m - 1.4, 0.95),
            velocity_mps=(0.0, 0.15, 0.0),
            length_m=0.3,
            surface="strip",
            surface_id="0",
            surface_position_m=along_m,
            surface_speed_mps=0.15,
        )
        in_air = models.TrackedObject(
            id="red in air",
            kind="red",
            position_m=(3.6, 0.6 * math.sin(swing), 1.2),
            velocity_mps=(0.0, 0.18 * math.cos(swing), 0.0),
            length_m=0.25,
        )
        crate = models.TrackedObject(id="blue crate", kind="blue", position_m=(3.8, 1.4, 1.0), length_m=0.6)
        stamp_ns = VirtualClock().now_ns() - 20_000_000
        camera.put(models.TrackedObjects(stamp_ns=stamp_ns, seq=tick, objects=(on_strip, in_air, crate)))


async def walks_by(bus: MemoryBus) -> None:
    """A tracked visitor walks through the area of the robots; somebody stops the quadrotor."""
    desk = _Desk(bus)
    pose = bus.publisher(topics.POSE, "visitor")
    for tick in range(230):
        time_s = 6.0 + 0.1 * tick
        await desk.at(time_s)
        x_m = 5.6 - 0.012 * tick
        y_m = 2.2 + 0.6 * math.sin(0.02 * tick)
        visitor = models.UserPose(
            stamp_ns=VirtualClock().now_ns(),
            seq=tick,
            position_m=(x_m, y_m, 0.0),
            yaw_rad=0.0,
            covariance=(0.01, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.01),
            method="external",
        )
        pose.put(visitor)
        if tick == 220:
            await desk.ask(topics.STOP_ROBOT, models.StopRobot(reason="cleaning"), "quad")


async def lights_lamps(bus: MemoryBus) -> None:
    """A lamp is told to flash faster than it may, and given back."""
    desk = _Desk(bus)
    colors = ((255, 0, 0), (20, 20, 0), (0, 0, 255))
    for tick in range(50):
        await desk.at(3.0 + 0.06 * tick)
        flash = models.SetLamp(color=colors[tick % 3])
        await desk.ask(topics.SET_LAMP, flash, "led_0")
    await desk.at(7.0)
    await desk.ask(topics.SET_LAMP, models.SetLamp(), "led_0")
    await desk.ask(topics.SET_BRIGHTNESS, models.SetBrightness(brightness=0.5))
