"""The service `arm`: hovers above what people point at, and takes and puts it when they press."""

import math
from collections.abc import Iterator
from typing import ClassVar

from pydantic import Field

from pointit.plugins import (
    NS_PER_S,
    Config,
    Context,
    PersonMessages,
    PersonRay,
    PointingPeople,
    Scope,
    Service,
    ServicePlugin,
    SiteState,
    Speech,
    TrackedObjects,
    follow_site,
    ticks,
    topics,
    vector,
)

from .messages import ARM_STATE, PUT_BACK, ArmState, PutBack, PutBackReply
from .shown_objects import shown_boxes, shown_links
from .simulated_arm import SimulatedArm, Vec3, joint_angles

RATE_HZ = 25.0
STANDS_M = 0.02
"""Distance from its goal at which the hand stands there, m."""
ARRIVED_M = 0.003
"""Distance from a goal of a program at which the next step begins, m."""
STAYS = 0.75
"""Share of the angle to the present box within which another one must be, to be meant instead."""
SUCTION_S = 0.3
APART = 1.4
"""Least distance of two boxes' middles, edges of a box."""
REACH_STEPS = 20
"""Number of steps in which a place within reach is looked for."""
WORDS_OF_YES = ("yes", "take it", "put it there")
WORDS_OF_NO = ("no", "put it back")
LOST = "the link to the arm is lost: it holds what it holds; mend the link"

Program = Iterator[None]
"""A motion of several steps. Each `next` is one tick of the arm."""


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


class Arm(Service[ArmConfig]):
    """Decides by its own view of all rays, so that the hand shows what a press would take."""

    NAME: ClassVar[str] = "arm"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = ArmConfig

    def __init__(self, config: ArmConfig, context: Context) -> None:
        super().__init__(config, context)
        base_x, base_y, base_z = config.base_m
        self._top_m = base_z + config.size_m
        """Height of the upper sides of boxes, at which the cup takes them, {W}, m."""
        self._boxes: dict[str, Vec3] = {
            f"box{number + 1}": (x, y, self._top_m) for number, (x, y) in enumerate(config.boxes_m)
        }
        """Middle of the upper side of each box, {W}, m."""
        self._park_m: Vec3 = (base_x - 0.5, base_y, self._top_m + 0.3)
        self.arm = SimulatedArm(config.base_m, self._park_m, self.clock)  # a real arm goes here

        # Where the hand is, where it goes, and from where it took a box
        self._tip_m = self._goal_m = self._from_m = self._park_m
        self._over = ""
        """Box above which the hand hovers, or goes."""
        self._held = ""
        self._program: Program | None = None
        self._people = PointingPeople()
        self._site = SiteState()
        """Poses of people who are there."""
        self._hindrance = ""
        """Reason why the hand cannot hover where its owner points, or an empty text."""
        self._text = ""
        """The last sentence to anybody."""
        self._messages = PersonMessages(self.bus, self.NAME)
        self._shown = ArmState(stamp_ns=self.clock.now_ns())

        # Subscriptions last: their handlers need what is above
        self._objects = self.bus.publisher(topics.OBJECTS, self.NAME)
        self._state = self.bus.publisher(ARM_STATE)
        self._state.put(self._shown)
        self.bus.serve(PUT_BACK, self._serve_put_back)
        self.bus.subscribe(topics.CURSOR, self._people.on_cursor)
        follow_site(self._site, self.bus, lambda: self.clock.now_ns() / NS_PER_S, (topics.POSE,))
        self.bus.subscribe(topics.BUTTON, lambda event, user: self._on_press(user, event.gesture))
        self.bus.subscribe(topics.SPEECH, self._on_speech)

    async def run(self) -> None:
        """Move the arm until cancelled."""
        async for now_ns in ticks(self.clock, RATE_HZ):
            self._tip_m = self.arm.tip_m()
            if self.arm.has_link:
                self._move(now_ns)
            if self._held:
                self._boxes[self._held] = self._tip_m
            self._advise()
            self._show(now_ns)

    def _move(self, now_ns: int) -> None:
        """Go on with the program, or without one hover where the owner points."""
        if self._program is None:
            self._hover(now_ns)
            return
        try:
            next(self._program)
        except StopIteration:
            self._program = None

    # What people do

    def _on_press(self, user: str, gesture: str) -> None:
        owner = self._people.owner
        if gesture != "press" or user not in self._people or not owner:
            return
        if user != owner:
            self._say(f"{owner} uses the arm: wait until they point elsewhere", user)
        elif not self.arm.has_link:
            self._say(LOST, user)
        elif self._program is not None:
            self._say("the arm is moving: wait until it hovers", user)
        elif self._hindrance:
            self._say(self._hindrance, user)
        elif self._held:
            self._program = self._put()
        else:
            self._program = self._take()

    def _on_speech(self, speech: Speech, user: str) -> None:
        if not speech.is_final:
            return
        words = " ".join(word.text.lower() for word in speech.words)
        if words in WORDS_OF_YES:
            self._on_press(user, "press")
        elif words in WORDS_OF_NO and user == self._people.owner:
            self._say(self._put_back(), user)

    async def _serve_put_back(self, _query: PutBack, _name: str) -> PutBackReply:
        return PutBackReply(text=self._put_back())

    # Hovering

    def _hover(self, now_ns: int) -> None:
        """Hover above the box that the owner means, or with a box where they point."""
        is_busy = bool(self._held)
        self._people.choose_owner(now_ns, lambda ray: bool(self._meant_box(ray)), is_busy=is_busy)
        self._hindrance = ""
        ray = self._people.owners_ray
        if ray is None:
            return
        wanted_m = ray.at_height(self._top_m) if self._held else self._top_of_meant_box(ray)
        if wanted_m is None:
            return

        # Beside a place that is out of reach, the hand still follows, so that the person can correct
        goal_m = self._above(wanted_m)
        reached_m = self._nearest_within_reach(goal_m)
        person = self._person_near(reached_m)
        if person:
            self._hindrance = f"{person} stands within {self.config.keep_out_m:g} m of that place: step back"
        else:
            self._goal_m = reached_m
            self.arm.move(reached_m)
        if reached_m != goal_m and not self._hindrance:
            self._hindrance = "that place is out of reach; point nearer to the arm"

        # Once, not at each tick
        if self._hindrance and self._hindrance != self._text:
            self._say(self._hindrance, self._people.owner)

    def _meant_box(self, ray: PersonRay) -> str:
        """Return the box nearest to a ray, or an empty name. Another one than `_over` must be much nearer."""
        angles = {name: ray.angle_to(top_m) for name, top_m in self._boxes.items()}
        if self._over in angles:
            angles[self._over] *= STAYS
        nearest = min(angles, key=angles.__getitem__, default="")
        if not nearest or angles[nearest] >= math.radians(self.config.snap_deg):
            return ""
        return nearest

    def _top_of_meant_box(self, ray: PersonRay) -> Vec3 | None:
        """Return the top of the box that the owner means, which is the one to hover above from now on."""
        self._over = self._meant_box(ray) or self._over
        return self._boxes.get(self._over)

    def _nearest_within_reach(self, goal_m: Vec3) -> Vec3:
        """Return the place nearest to `goal_m`, on the line to where the arm was parked, that is in reach."""
        way_m = vector.subtract(goal_m, self._park_m)
        for step in range(REACH_STEPS, 0, -1):
            place_m = vector.add(self._park_m, vector.scale(way_m, step / REACH_STEPS))
            if joint_angles(self.config.base_m, place_m) is not None:
                return place_m
        return self._park_m

    # Programs

    def _take(self) -> Program:
        box = next((name for name, top_m in self._boxes.items() if self._stands_over(top_m)), "")
        if not box or box != self._over:
            where = f"the hand is on its way to {self._over}" if self._over else "the hand is above no box"
            self._tell_owner(f"nothing is taken: {where}; press when it stands above the right one")
            return
        top_m = self._from_m = self._boxes[box]
        yield from self._go(top_m)
        self.arm.grip(on=True)
        yield from self._wait(SUCTION_S)

        # Only what the cup feels is held
        if self.arm.holds and math.dist(self._tip_m, top_m) < STANDS_M:
            self._held = box
        else:
            self.arm.grip(on=False)
            self._tell_owner(f"nothing is held: the cup missed {box}; press again")
        yield from self._go(self._above(top_m))

    def _put(self) -> Program:
        x, y, _ = self._tip_m
        neighbour = self._box_in_the_way(x, y)
        if not self._stands_over(self._goal_m):
            self._tell_owner("the hand is on its way; press when it stands above the place")
        elif neighbour:
            self._tell_owner(f"that place is occupied by {neighbour}; point beside it")
        else:
            yield from self._lower((x, y, self._top_m))

    def _lower(self, place_m: Vec3) -> Program:
        """Lay the held box at `place_m`, and rise."""
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

    def _go(self, goal_m: Vec3) -> Program:
        """Move to `goal_m`. Stand while a person is near it."""
        while math.dist(self._tip_m, goal_m) > ARRIVED_M:
            stands = self._person_near(goal_m)
            self.arm.move(self._tip_m if stands else goal_m)
            yield

    def _wait(self, wait_s: float) -> Program:
        end_ns = self.clock.now_ns() + round(wait_s * NS_PER_S)
        while self.clock.now_ns() < end_ns:
            yield

    # Places

    def _above(self, top_m: Vec3) -> Vec3:
        """Return where the hand hovers above `top_m`, with what it holds."""
        x, y, _ = top_m
        lift_m = self.config.size_m if self._held else 0.0
        return (x, y, self._top_m + self.config.hover_m + lift_m)

    def _stands_over(self, point_m: Vec3) -> bool:
        return math.dist(self._tip_m[:2], point_m[:2]) < STANDS_M

    def _box_in_the_way(self, x: float, y: float) -> str:
        """Return a box that leaves no room for the held one at (x, y), or an empty name."""
        apart_m = APART * self.config.size_m
        for name, top_m in self._boxes.items():
            if name != self._held and math.dist(top_m[:2], (x, y)) < apart_m:
                return name
        return ""

    def _person_near(self, point_m: Vec3) -> str:
        """Return a person within `keep_out_m` of `point_m` on the floor, or an empty name."""
        for user, pose in self._site.all(topics.POSE).items():
            if math.dist(pose.position_m[:2], point_m[:2]) < self.config.keep_out_m:
                return user
        return ""

    # Sentences and states

    def _say(self, text: str, user: str) -> None:
        self._text = text
        self._messages.tell(user, text)

    def _tell_owner(self, text: str) -> None:
        self._say(text, self._people.owner)

    def _advise(self) -> None:
        """Say what the owner's next press does. Their page, phone and terminal show it while they point."""
        if not self._people.owner:
            return
        advice = "Point at a box: the hand hovers above it. Press, and it is taken."
        if self._held:
            advice = f"Point at a place for {self._held} and press: it is put there."
        self._messages.advise(self._people.owner, advice)

    def _phase(self) -> str:
        if not self.arm.has_link:
            return "lost"
        if self._program is not None:
            return "moving"
        if self._held:
            return "holding"
        return "hovering" if self._over else "idle"

    def _show(self, now_ns: int) -> None:
        """Publish the objects, and the state if it has changed."""
        state = ArmState(
            stamp_ns=self._shown.stamp_ns,
            phase=self._phase(),
            user=self._people.owner,
            over=self._over,
            holds=self._held,
            text=self._text,
        )
        if state != self._shown:
            self._shown = state.model_copy(update={"stamp_ns": now_ns})
            self._state.put(self._shown)
        boxes = shown_boxes(self._boxes, self.config.size_m)
        links = shown_links(self.config.base_m, self._tip_m)
        self._objects.put(TrackedObjects(stamp_ns=now_ns, objects=(*boxes, *links)))


ARM = ServicePlugin(
    summary="an arm that takes what people point at",
    config=ArmConfig,
    make=Arm,
    reads=(topics.CURSOR, topics.POSE, topics.BUTTON, topics.SPEECH),
    writes=(topics.OBJECTS, ARM_STATE),
    serves=(PUT_BACK,),
    asks=(topics.SAY,),
)
