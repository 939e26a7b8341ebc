"""The site of a session: shown targets, and the messages of the attempt that goes on."""

import asyncio
import contextlib
import functools
import math
from collections.abc import AsyncGenerator, AsyncIterator, Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import pointit
from pointit.errors import NoMessageError, PointItError
from pointit.forearm.true_pose import TruePose, find_true_poses
from pointit.geometry.floor_sigma import position_sigma_m, yaw_sigma_rad
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, ActOutcome, Announced, Cursor, Environment, SelectionEvent, topics
from pointit.site.site_state import ActResults
from pointit.study.measure import SILENT_S, Attempt
from pointit.study.model import Value
from pointit.study.tasks import StudyScene
from pointit.study.view import Point, TopView, flat

TRACKER = "study"
SHOW_S = 0.1
"""Time between two reports of the targets, s."""
TIMEOUT_S = 5.0
"""Time for a package to appear, s."""
TARGET_COLOR = "#ff1e00"
DWELL = {"gauge": "selector.gauge.full_s", "hold": "selector.window_s", "fraction": "selector.window_s"}
"""Parameter that is the time of dwelling, by method."""
LIVE = frozenset({"selector.method", *DWELL.values(), "conveyor-sim.speed_mps"})
"""Parameters that change without a new start."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SiteOptions:
    """Devices and options of the site of a session."""

    imu: str = ""
    output: str = ""
    localize: bool = False
    listen: str = ""
    record: bool = False
    lsl: bool = False
    person: Mapping[str, Value] = field(default_factory=dict[str, Value])
    """Parameters of a simulated person."""


class StudySite:
    """One participant at a site."""

    def __init__(
        self, site: pointit.Site, user: str, settings: Mapping[str, Value], environment: Environment
    ) -> None:
        """Use `site`; `at` is the way in."""
        self.site = site
        self.map = environment
        self.attempt: Attempt | None = None
        self._act_results = ActResults()
        self._arrivals: dict[tuple[str, int], tuple[Attempt, int]] = {}
        """Attempt in which each event of it arrived, and when, ns, by object and stamp."""
        self.on_message: Callable[[object, int], None] = lambda _message, _now_ns: None
        """Called with each message of the person, and the time of its arrival, ns."""
        self.truth_tracker = ""
        """Tracker of the participant's true pose, which the study declares, or `""`."""
        self.has_names = False
        """True if names are spoken to the participant."""
        self.configuration: dict[str, str] = {}
        """Parameters of all services, JSON, by instance."""
        self._user = user
        self._settings = dict(settings)
        self._tracker = site.tracker(TRACKER)
        self._scene: StudyScene | None = None
        self._received_ns = 0
        self._true_pose: TruePose | None = None
        self._cursor: Cursor | None = None
        self._tasks: list[asyncio.Task[None]] = []

    @classmethod
    @contextlib.asynccontextmanager
    async def at(cls, run: Any, user: str, settings: Mapping[str, Value]) -> AsyncGenerator[Self]:
        """Yield the site that `run`, from `pointit.run`, starts."""
        async with run as site:
            joined = cls(site, user, settings, await site.latest.map.wait())
            joined._begin()
            try:
                yield joined
            finally:
                for task in joined._tasks:
                    task.cancel()
                await asyncio.gather(*joined._tasks, return_exceptions=True)

    def is_live(self, settings: Mapping[str, Value]) -> bool:
        """Return True if `settings` can be used without a new start."""
        names = self._settings.keys() | settings.keys()
        changed = {name for name in names if self._settings.get(name) != settings.get(name)}
        if not changed <= LIVE & settings.keys():
            return False
        # The dwell of another method is not sent.
        dwell = DWELL.get(str(settings.get("selector.method")), "")
        return changed & set(DWELL.values()) <= {dwell}

    async def use(self, settings: Mapping[str, Value]) -> None:
        """Change the live parameters to those of `settings`."""
        method = settings.get("selector.method")
        dwell_s = settings.get(DWELL.get(str(method), ""))
        if method is not None or dwell_s is not None:
            seconds = None if dwell_s is None else float(dwell_s)
            await self.site.select.method(None if method is None else str(method), dwell_s=seconds)
        speed = settings.get("conveyor-sim.speed_mps")
        if speed is not None:
            await self.site.conveyor.set_speed(float(speed))
        self._settings = dict(settings)

    @property
    def problem(self) -> str:
        """Instruction to the participant if they do not point, else `""`."""
        for task in self._tasks:
            if task.done():
                task.result()
        with contextlib.suppress(NoMessageError):
            interaction = self.site.latest.interaction[self._user]
            if interaction.state != "pointing":
                return interaction.next_step or "press the button to begin to point"
        if self.site.now_ns() - self._received_ns > SILENT_S * NS_PER_S:
            return "no ray comes: is the wrist on, and in reach?"
        return self.truth_problem

    @property
    def truth_problem(self) -> str:
        """Sentence if the true pose, which the study declares, does not come, else `""`."""
        if not self.truth_tracker:
            return ""
        pose = self._true_pose
        oldest_ns = self.site.now_ns() - SILENT_S * NS_PER_S
        if pose is not None and pose.stamp_ns > oldest_ns:
            return ""
        return (
            f"the tracker {self.truth_tracker} sees no {self._user}: start it with `truth: true`, and check "
            "that their bodies are seen"
        )

    @property
    def quality(self) -> str:
        """Standard deviations of the participant's localization, or `""` if it is unknown or given."""
        pose = self.site.latest.pose.get(self._user)
        if pose is None or not any(pose.covariance):
            return ""
        sigma_cm = position_sigma_m(pose.covariance) * 100
        sigma_deg = math.degrees(yaw_sigma_rad(pose.covariance))
        text = f"position ±{sigma_cm:.0f} cm, yaw ±{sigma_deg:.1f}°"
        if self.truth_problem or self._true_pose is None:
            return text
        error = self._true_pose.error_of(pose)
        if error is None:
            return text
        text += f"; true error {error.position_m * 100:.0f} cm"
        if error.yaw_rad is not None:
            text += f", {math.degrees(error.yaw_rad):+.1f}°"
        return text

    @property
    def live(self) -> TopView:
        """The room from above, as it is now."""
        pose = self.site.latest.pose.get(self._user)
        attempt = self.attempt
        view = TopView(
            lines=self._lines,
            person=None if pose is None else flat(pose.position_m),
            eyes=None,
            direction=None,
            cursor=None,
            target=None if attempt is None else flat(attempt.target_m),
        )
        is_silent = self.site.now_ns() - self._received_ns > SILENT_S * NS_PER_S
        cursor = self._cursor
        if cursor is None or is_silent:
            return view
        return replace(
            view,
            eyes=flat(cursor.origin_m),
            direction=flat(cursor.direction),
            cursor=flat(cursor.point_m),
        )

    @functools.cached_property
    def _lines(self) -> tuple[tuple[Point, ...], ...]:
        room = self.map
        lines: list[Sequence[Sequence[float]]] = [strip.line_m for strip in room.strips]
        lines += [belt.line_m for belt in room.belts]
        lines += [(*fence.outline_m, fence.outline_m[0]) for fence in room.fences]
        return tuple(tuple(filter(None, map(flat, line))) for line in lines)

    async def show(self, scene: StudyScene) -> tuple[str, Vec3]:
        """Show the target of `scene`; return its id and position as soon as it is there.

        Raises: PointItError: If a package does not appear, or a request is refused.
        """
        if scene.say:
            await self.site.feedback.say(self._user, scene.say)

        # A target at a place that is known is there at once.
        if scene.target_m is not None:
            self._scene = scene
            self._tracker.update(scene.objects)
            if scene.lamp:
                await self.site.lamp(scene.lamp).set(TARGET_COLOR)
            if scene.localize:
                await self.site.localizer.start(self._user, scene.localize)
            return scene.target, scene.target_m

        # Packages appear when the conveyor reports them. The target is the first one.
        conveyor = self.site.conveyor
        await conveyor.reset()
        await conveyor.set_feeding(False)
        ids: list[str] = []
        for package in scene.packages:
            reply = await conveyor.add_package(
                package.kind, lane=package.lane, length_m=package.length_m, position=package.position
            )
            ids.append(reply.object_id)
        target = ids[0]
        end_ns = self.site.now_ns() + TIMEOUT_S * NS_PER_S
        place_m = self.position(target)
        while place_m is None:
            if self.site.now_ns() > end_ns:
                raise PointItError(
                    f"package {target} does not appear within {TIMEOUT_S:g} s; see `pointit doctor`"
                )
            await self.site.sleep(SHOW_S / 2)
            place_m = self.position(target)
        self._scene = scene
        return target, place_m

    def position(self, object_id: str) -> Vec3 | None:
        """Return the last reported position of an object, {W}, or None."""
        for message in self.site.latest.objects.values():
            for tracked in message.objects:
                if tracked.id == object_id:
                    return tracked.position_m
        return None

    async def hide(self) -> None:
        """Hide the target."""
        scene = self._scene
        self._scene = None
        self.attempt = None
        self._arrivals.clear()
        self._tracker.update(())
        if scene is None:
            return
        if scene.lamp:
            await self.site.lamp(scene.lamp).set(None)
        if scene.packages:
            await self.site.conveyor.reset()
        if scene.say:
            await self.site.feedback.say(self._user, "Wait for the next one.")
        if scene.localize and self.site.latest.interaction[self._user].state == "localizing":
            await self.site.localizer.cancel(self._user)

    def _begin(self) -> None:
        site = self.site
        user = self._user
        site.latest.interaction.get(user)  # received from now on
        site.latest.objects.get(TRACKER)
        site.latest.pose.get(user)
        work = (
            self._pump(site.cursors(user), Attempt.on_cursor),
            self._pump(site.hovers(user), Attempt.on_hover),
            self._pump(site.selections(), self._on_selection),
            self._pump(site.messages(topics.OUTCOMES), self._on_selection),
            self._pump(site.messages(topics.BUTTON, user), Attempt.on_press),
            self._pump(site.messages(topics.ANNOUNCED, user), Attempt.on_announced),
            self._pump(site.messages(topics.STEP, user), Attempt.on_step),
            self._report(),
            self._configure(),
            self._follow_robots(),
            self._follow_localization(),
            self._follow_truth(),
        )
        self._tasks = [asyncio.create_task(coroutine) for coroutine in work]

    async def _pump(self, feed: AsyncIterator[Any], handle: Callable[[Attempt, Any, int], None]) -> None:
        """Pass messages to the attempt that goes on."""
        async for message in feed:
            now_ns = self.site.now_ns()
            if isinstance(message, Cursor):
                self._received_ns = now_ns
                self._cursor = message
            self.has_names |= isinstance(message, Announced)
            self.on_message(message, now_ns)  # first, as LSL pairs its clock with this time
            if self.attempt is not None:
                handle(self.attempt, message, now_ns)

    def _on_selection(self, attempt: Attempt, message: SelectionEvent | ActOutcome, now_ns: int) -> None:
        """Pass an event on once it is known that it was done, with the time at which it arrived."""
        if isinstance(message, SelectionEvent):
            self._arrivals[message.object_id, message.stamp_ns] = (attempt, now_ns)
        event = self._act_results.event_to_show(message)
        if event is None:
            return
        arrival = self._arrivals.pop((event.object_id, event.stamp_ns), None)
        if arrival is not None:
            asked_in, arrived_ns = arrival
            asked_in.on_selection(event, arrived_ns)

    async def _follow_robots(self) -> None:
        async for name, state in self.site.messages(topics.ROBOT_STATE).items():
            if self.attempt is None or self._scene is None:
                continue
            if self._scene.robot == name:
                self.attempt.on_robot(state, self.site.now_ns())

    async def _follow_localization(self) -> None:
        async for state in self.site.messages(topics.LOCALIZATION, self._user):
            if self.attempt is None or self._scene is None:
                continue
            if self._scene.localize:
                pose = self.site.latest.pose.get(self._user)
                position_m = None if pose is None else pose.position_m
                self.attempt.on_localization(state, position_m, self.site.now_ns())

    async def _follow_truth(self) -> None:
        async for tracker, message in self.site.messages(topics.OBJECTS).items():
            if tracker == self.truth_tracker:
                pose = find_true_poses({tracker: message}).get(self._user)
                if pose is not None:
                    self._true_pose = pose
                    self.on_message(pose, self.site.now_ns())

    async def _configure(self) -> None:
        async for message in self.site.messages(topics.CONFIGURATION):
            self.configuration[message.instance] = message.parameters

    async def _report(self) -> None:
        while True:
            self._tracker.update(self._scene.objects if self._scene is not None else ())
            await self.site.sleep(SHOW_S)
