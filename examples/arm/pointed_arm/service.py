"""The service `arm`: hovers above what people point at, and takes and puts it when they press."""

import asyncio
import math
from collections.abc import Coroutine, Generator, Iterator
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from pointit import PointItError
from pointit.plugins import (
    NS_PER_S,
    Config,
    Context,
    Cursor,
    Delivery,
    Message,
    Query,
    Reply,
    Request,
    Scope,
    Service,
    ServicePlugin,
    Speech,
    Topic,
    TrackedObject,
    TrackedObjects,
    ticks,
    topics,
)

from .simulated_arm import SimulatedArm, Vec3, joint_angles, link_ends

RATE_HZ = 25.0
SMOOTH_S = 0.15
"""Time constant of the smoothing of a ray, s."""
FRESH_S = 1.0
"""Age up to which a ray counts, s."""
QUIET_S = 2.0
"""Time without a ray near the boxes after which others may use the arm, s."""
STANDS_M = 0.02
"""Distance from its goal at which the hand stands there, m."""
STAYS = 0.75
"""Share of the angle to the present box within which another one must be, to be meant instead."""
SUCTION_S = 0.3
BEAD_M = (0.06, 0.06, 0.06)
LOST = "the link to the arm is lost: it holds what it holds; mend the link"
COLORS = ("red", "green", "blue", "yellow", "orange", "purple")


class ArmConfig(Config):
    """The arm, its boxes, and the people before it."""

    base_m: Vec3 = Field(default=(2.05, 0.0, 0.72), description="foot of the arm on its table, {W}, m")
    boxes_m: tuple[tuple[float, float], ...] = Field(
        default=tuple((1.4 + 0.2 * row, -0.3 + 0.2 * column) for row in (0, 1) for column in range(4)),
        description="x and y of the boxes at the start, {W}, m",
    )
    size_m: float = Field(default=0.06, gt=0, le=0.3, description="edge of the boxes, m")
    hover_m: float = Field(default=0.12, gt=0, le=1, description="height of the hand above what it means, m")
    snap_deg: float = Field(default=12.0, gt=0, le=45, description="angle up to which a box is meant, deg")
    keep_out_m: float = Field(
        default=0.5, ge=0, le=5, description="distance that the hand keeps from people's known positions, m"
    )


class ArmState(Message):
    """The work of the arm: `lost`, `moving`, `holding`, `hovering` or `idle`, for whom, its last words."""

    phase: str = "idle"
    user: str = ""
    over: str = ""
    """Box above which the hand hovers, or goes."""
    holds: str = ""
    text: str = ""


class PutBack(Query):
    """Lay the box that the arm holds, or has begun to take, where it was."""


class Told(Reply):
    """The arm's answer."""

    text: str


ARM_STATE = Topic(
    key="arm/state", message=ArmState, delivery=Delivery.STATE, rate_hz=None, writers=("arm",),
    about="what the arm hovers over, holds and says",
)  # fmt: skip
PUT_BACK = Request(
    key="arm/put_back", query=PutBack, reply=Told, server="arm", about="lay the box where it was"
)
Program = Generator[None, None, None]
Ray = tuple[int, Vec3, np.ndarray[Any, Any]]
"""Stamp, origin and direction."""


class Arm(Service[ArmConfig]):
    """Decides by its own view of all rays, so that the hand shows what a press would take."""

    NAME: ClassVar[str] = "arm"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = ArmConfig

    def __init__(self, config: ArmConfig, context: Context) -> None:
        super().__init__(config, context)
        self._top_m = config.base_m[2] + config.size_m
        """Height of the upper sides of boxes, at which the cup takes them, {W}, m."""
        self._boxes: dict[str, Vec3] = {
            f"box{number + 1}": (x, y, self._top_m) for number, (x, y) in enumerate(config.boxes_m)
        }
        """Middle of the upper side of each box, {W}, m."""
        self._park_m: Vec3 = (config.base_m[0] - 0.5, config.base_m[1], self._top_m + 0.3)
        self.arm = SimulatedArm(config.base_m, self._park_m, self.clock)  # a real arm goes here
        self._tip = self._goal = self._from_m = self._park_m
        self._over = self._held = self._owner = self._text = ""
        self._hindrance = ""
        """Reason why the hand cannot hover where its owner points, or an empty text."""
        self._program: Program | None = None
        self._rays: dict[str, Ray] = {}
        self._people_m: dict[str, Vec3] = {}
        self._near_ns = 0
        """Last time at which the owner pointed near a box, ns."""
        self._shown = ArmState(stamp_ns=self.clock.now_ns())
        self._advised = ("", "")
        """Person who was advised last, and the advice."""
        self._telling: set[asyncio.Task[None]] = set()
        self._objects = self.bus.publisher(topics.OBJECTS, self.NAME)
        self._state = self.bus.publisher(ARM_STATE)
        self._state.put(self._shown)
        self.bus.serve(PUT_BACK, self._serve_put_back)
        self.bus.subscribe(topics.CURSOR, self._on_cursor)
        self.bus.subscribe(topics.POSE, lambda pose, user: self._people_m.update({user: pose.position_m}))
        self.bus.subscribe(topics.BUTTON, lambda event, user: self._on_press(user, event.gesture))
        self.bus.subscribe(topics.SPEECH, self._on_speech)

    async def run(self) -> None:
        """Move the arm until cancelled."""
        async for now_ns in ticks(self.clock, RATE_HZ):
            self._tip = self.arm.tip_m()
            if self.arm.has_link and self._program is not None:
                self._program = None if next(self._program, self) is self else self._program
            elif self.arm.has_link:
                self._hover(now_ns)
            if self._held:
                self._boxes[self._held] = self._tip
            self._show(now_ns)

    def _on_cursor(self, cursor: Cursor, user: str) -> None:
        if cursor.origin_m is None or cursor.direction is None:
            self._rays.pop(user, None)
            return
        direction = np.array(cursor.direction)
        if user in self._rays:
            before_ns, _, before = self._rays[user]
            share = min(max(cursor.stamp_ns - before_ns, 0) / NS_PER_S / SMOOTH_S, 1.0)
            direction = before + share * (direction - before)
        self._rays[user] = (cursor.stamp_ns, cursor.origin_m, direction / np.linalg.norm(direction))

    def _on_speech(self, speech: Speech, user: str) -> None:
        words = " ".join(word.text.lower() for word in speech.words) if speech.is_final else ""
        if words in ("yes", "take it", "put it there"):
            self._on_press(user, "press")
        elif words in ("no", "put it back") and user == self._owner:
            self._say(self._put_back())

    async def _serve_put_back(self, _query: PutBack, _name: str) -> Told:
        return Told(text=self._put_back())

    def _on_press(self, user: str, gesture: str) -> None:
        if gesture != "press" or user not in self._rays or not self._owner:
            return
        if user != self._owner:
            self._say(f"{self._owner} uses the arm: wait until they point elsewhere", user)
        elif not self.arm.has_link:
            self._say(LOST)
        elif self._program is not None:
            self._say("the arm is moving: wait until it hovers")
        elif self._hindrance:
            self._say(self._hindrance)
        else:
            self._program = self._put() if self._held else self._take()

    def _take(self) -> Program:
        box = next((name for name, at_m in self._boxes.items() if self._is_over(at_m)), "")
        if not box or box != self._over:
            there = f"the hand is on its way to {self._over}" if self._over else "the hand is above no box"
            self._say(f"nothing is taken: {there}; press when it stands above the right one")
            return
        top_m = self._from_m = self._boxes[box]
        yield from self._go(top_m)
        self.arm.grip(on=True)
        yield from self._wait(SUCTION_S)
        if self.arm.holds and math.dist(self._tip, top_m) < STANDS_M:
            self._held = box
        else:
            self.arm.grip(on=False)
            self._say(f"nothing is held: the cup missed {box}; press again")
        yield from self._go(self._above(top_m))

    def _put(self) -> Program:
        place_m = (self._tip[0], self._tip[1], self._top_m)
        others = (name for name in self._boxes if name != self._held)
        wide_m = 1.4 * self.config.size_m
        near = next((name for name in others if math.dist(self._boxes[name][:2], place_m[:2]) < wide_m), "")
        if not self._is_over(self._goal):
            self._say("the hand is on its way; press when it stands above the place")
        elif near:
            self._say(f"that place is occupied by {near}; point beside it")
        else:
            yield from self._lower(place_m)

    def _lower(self, place_m: Vec3) -> Program:
        yield from self._go(self._above(place_m))
        yield from self._go(place_m)
        self.arm.grip(on=False)
        self._boxes[self._held] = place_m
        self._held = ""
        self._over = ""
        yield from self._wait(SUCTION_S)
        yield from self._go(self._above(place_m))

    def _put_back(self) -> str:
        """Return a held box to its place, or stop taking one. Returns the sentence about it."""
        if not self.arm.has_link:
            return LOST
        if self._held:
            self._program = self._lower(self._from_m)
            return f"{self._held} goes back"
        if self._program is None:
            return "nothing is held, so nothing goes back; point at a box and press to take it"
        self.arm.grip(on=False)
        self._program = self._go(self._above(self._from_m))
        return "nothing is taken"

    def _hover(self, now_ns: int) -> None:
        """Hover above the box that the owner means, or with a box where they point."""
        self._choose_owner(now_ns)
        self._hindrance = ""
        if self._owner not in self._rays:
            return
        wanted = self._place(self._rays[self._owner]) if self._held else self._box(self._rays[self._owner])
        if wanted is None:
            return
        goal = self._above(wanted)
        near = self._within_reach(goal)
        if who := self._person_near(near):
            self._hindrance = f"{who} stands within {self.config.keep_out_m:g} m of that place: step back"
        else:
            self._goal = near
            self.arm.move(near)  # also beside a place that is out of reach, so that the person can correct
        if near != goal:
            self._hindrance = self._hindrance or "that place is out of reach; point nearer to the arm"
        if self._hindrance and self._hindrance != self._text:
            self._say(self._hindrance)

    def _within_reach(self, goal_m: Vec3) -> Vec3:
        """Return the place nearest to `goal_m`, on the line to where the arm was parked, that is in reach."""
        way = np.subtract(goal_m, self._park_m)
        for share in np.linspace(1.0, 0.0, 21):
            x, y, z = (self._park_m + share * way).tolist()
            if joint_angles(self.config.base_m, (x, y, z)) is not None:
                return (x, y, z)
        return self._park_m

    def _choose_owner(self, now_ns: int) -> None:
        self._rays = {user: ray for user, ray in self._rays.items() if now_ns - ray[0] < FRESH_S * NS_PER_S}
        near = [user for user, ray in self._rays.items() if self._nearest(ray)]
        if self._owner in near:
            self._near_ns = now_ns
        elif not self._owner or (now_ns - self._near_ns > QUIET_S * NS_PER_S and not self._held):
            self._owner = min(near, default="")
            self._near_ns = now_ns

    def _nearest(self, ray: Ray) -> str:
        """Return the box nearest to a ray, or an empty name. Another one than `_over` must be much nearer."""
        angles = {name: _angle(ray, at_m) for name, at_m in self._boxes.items()}
        angles = {name: STAYS * angle if name == self._over else angle for name, angle in angles.items()}
        best = min(angles, key=angles.__getitem__, default="")
        return best if best and angles[best] < math.radians(self.config.snap_deg) else ""

    def _box(self, ray: Ray) -> Vec3 | None:
        """Return the top of the box that the owner means, which is the one to hover above from now on."""
        self._over = self._nearest(ray) or self._over
        return self._boxes.get(self._over)

    def _place(self, ray: Ray) -> Vec3 | None:
        """Return where the ray meets the table, at the height of the held box's upper side."""
        _, origin_m, direction = ray
        if direction[2] > -0.05:
            return None
        x, y, _ = (np.array(origin_m) + (self._top_m - origin_m[2]) / direction[2] * direction).tolist()
        return (x, y, self._top_m)

    def _above(self, top_m: Vec3) -> Vec3:
        lift_m = self.config.size_m if self._held else 0.0
        return (top_m[0], top_m[1], self._top_m + self.config.hover_m + lift_m)

    def _is_over(self, point_m: Vec3) -> bool:
        return math.dist(self._tip[:2], point_m[:2]) < STANDS_M

    def _person_near(self, point_m: Vec3) -> str:
        keep_out_m = self.config.keep_out_m
        people = self._people_m.items()
        return next((user for user, at_m in people if math.dist(at_m[:2], point_m[:2]) < keep_out_m), "")

    def _go(self, goal_m: Vec3) -> Program:
        """Move to `goal_m`. Stand while a person is near it."""
        while math.dist(self._tip, goal_m) > 0.003:
            self.arm.move(self._tip if self._person_near(goal_m) else goal_m)
            yield

    def _wait(self, wait_s: float) -> Program:
        end_ns = self.clock.now_ns() + round(wait_s * NS_PER_S)
        while self.clock.now_ns() < end_ns:
            yield

    def _say(self, text: str, user: str = "") -> None:
        """Publish `text`, and have the person's supervisor tell it to them. Without `user`: to the owner."""
        self._text = text
        self._start(self._tell(user or self._owner, text))

    def _advise(self) -> None:
        """Tell the owner what a press does next. Their page, phone and terminal show it while they point."""
        holds = f"Point at a place for {self._held}"
        takes = "Point at a box: the hand hovers above it"
        advice = f"{holds} and press: it is put there." if self._held else f"{takes}. Press, and it is taken."
        if self._owner and (self._owner, advice) != self._advised:
            self._advised = (self._owner, advice)
            self._start(self._tell(self._owner, advice, stays=True))

    def _start(self, telling: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(telling)
        self._telling.add(task)
        task.add_done_callback(self._telling.discard)

    async def _tell(self, user: str, text: str, *, stays: bool = False) -> None:
        try:
            await self.bus.call(topics.SAY, topics.SAY.query(text=text, stays=stays, service=self.NAME), user)
        except PointItError as error:  # a person without a supervisor: the state has the sentence
            self.bus.warn("arm-untold", f"{user} is not told {text!r}: {error}", user)

    def _show(self, now_ns: int) -> None:
        self._advise()
        rest = "holding" if self._held else "hovering" if self._over else "idle"
        phase = "lost" if not self.arm.has_link else rest if self._program is None else "moving"
        state = ArmState(
            stamp_ns=self._shown.stamp_ns, phase=phase, user=self._owner,
            over=self._over, holds=self._held, text=self._text,
        )  # fmt: skip
        if state != self._shown:
            self._shown = state.model_copy(update={"stamp_ns": now_ns})
            self._state.put(self._shown)
        objects = (*self._shown_boxes(), *self._shown_links())
        self._objects.put(TrackedObjects(stamp_ns=now_ns, objects=objects))

    def _shown_boxes(self) -> Iterator[TrackedObject]:
        size_m = self.config.size_m
        for number, (name, (x, y, z)) in enumerate(self._boxes.items()):
            yield TrackedObject(
                id=name, kind=COLORS[number % len(COLORS)], position_m=(x, y, z - size_m / 2.0),
                length_m=size_m, size_m=(size_m,) * 3, press=True,
            )  # fmt: skip

    def _shown_links(self) -> Iterator[TrackedObject]:
        """Return beads along the links, as the page draws boxes only, and the hand."""
        angles = joint_angles(self.config.base_m, self._tip)
        ends = [self.config.base_m, *(link_ends(self.config.base_m, angles) if angles else ())]
        for link, (start, end) in enumerate(pairwise(ends)):
            for bead in range(7):
                x, y, z = (np.array(start) + bead / 7.0 * np.subtract(end, start)).tolist()
                yield TrackedObject(id=f"arm.{link}.{bead}", kind="arm", position_m=(x, y, z), size_m=BEAD_M)
        yield TrackedObject(id="hand", kind="arm", position_m=self._tip, length_m=0.05)


def _angle(ray: Ray, point_m: Vec3) -> float:
    to = np.subtract(point_m, ray[1])
    return math.atan2(float(np.linalg.norm(np.cross(ray[2], to))), float(ray[2] @ to))


ARM = ServicePlugin(
    summary="an arm that takes what people point at",
    config=ArmConfig,
    make=Arm,
    reads=(topics.CURSOR, topics.POSE, topics.BUTTON, topics.SPEECH),
    writes=(topics.OBJECTS, ARM_STATE),
    serves=(PUT_BACK,),
    asks=(topics.SAY,),
)
