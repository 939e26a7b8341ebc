"""Observer of a run: the newest messages of every kind, for the view and the summary."""

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from pointit.launch.plan.plan import Watcher
from pointit.launch.run.score import Latency, RunScore
from pointit.runtime.bus.contract import Bus, Closable
from pointit.runtime.clock import Clock
from pointit.schemas import (
    Anchor,
    Cursor,
    Environment,
    Feedback,
    Health,
    Hover,
    Interaction,
    LampColor,
    Localization,
    SelectionEvent,
    StripsFrame,
    UserPose,
    topics,
)
from pointit.schemas.base import Rgb
from pointit.schemas.text import one_line
from pointit.services.led_driver.outputs import FRAME_RATE
from pointit.services.registry import RECORDER

LINES = 5
"""Recent events kept for the view."""
FOUND = ("static_targets", "moving_target")
"""Pose methods of localization by pointing."""
TOGETHER_NS = 500_000_000
"""Maximum age of a pose relative to its Localization: a pose is stamped with its newest ray."""


@dataclass
class Monitor:
    """Subscribes like any other subscriber and holds the newest messages."""

    score: RunScore
    clock: Clock
    person: str = ""
    """The only person whose activity is reported, or `""` for all."""
    tell: Callable[[str], object] | None = None
    """Called with each event line."""
    watchers: Sequence[Watcher] = ()
    environment: Environment | None = None
    frame: StripsFrame | None = None
    cursors: dict[str, Cursor] = field(default_factory=dict[str, Cursor])
    hovers: dict[str, Hover] = field(default_factory=dict[str, Hover])
    interactions: dict[str, Interaction] = field(default_factory=dict[str, Interaction])
    poses: dict[str, UserPose] = field(default_factory=dict[str, UserPose])
    found: dict[str, UserPose] = field(default_factory=dict[str, UserPose])
    """Last poses found by pointing, also of people who have left."""
    solved: dict[str, int] = field(default_factory=dict[str, int])
    """Stamps of solved localizations whose pose has not arrived yet."""
    localizations: dict[str, Localization] = field(default_factory=dict[str, Localization])
    refusals: dict[str, str] = field(default_factory=dict[str, str])
    """Last refusal reason of the localizer by person, until they try again."""
    cues: dict[str, str] = field(default_factory=dict[str, str])
    """Text of the last refusal cue by person, until they try again; the selector also refuses."""
    colors: dict[str, Rgb] = field(default_factory=dict[str, Rgb])
    """Each person's colour."""
    lamps: dict[str, LampColor] = field(default_factory=dict[str, LampColor])
    health: dict[str, Health] = field(default_factory=dict[str, Health])
    heard_s: dict[str, float] = field(default_factory=dict[str, float])
    """Monotonic time of a service's last Health, since another machine's clock may differ."""
    events: deque[str] = field(default_factory=lambda: deque(maxlen=LINES))
    latency: Latency = field(default_factory=Latency)
    is_recorded: bool = False
    """A recorder is present on the site."""
    cursor_count: int = 0
    """Number of cursors on a surface."""
    frame_count: int = 0
    lamp_misses_rad: dict[str, float] = field(default_factory=dict[str, float])
    """Smallest angle between a ray and each lamp that was pointed at."""
    first_cursor_unix_s: float | None = None
    """Wall time of the first cursor on a surface."""
    first_frame_unix_s: float | None = None
    """Wall time of the first light on the strips: everything runs."""
    _light_hz: dict[str, tuple[float, int]] = field(default_factory=dict[str, tuple[float, int]])
    """Sum and number of the frame rates that each controller's port reported."""
    _listening: list[Closable] = field(default_factory=list[Closable])

    def attach(self, bus: Bus) -> None:
        """Subscribe on `bus`; where one person is shown, to no one else's cursors and the like."""
        user_pattern = self.person or topics.ANY
        self._listening += [
            bus.subscribe(topics.MAP, self._on_map),
            bus.subscribe(topics.OBJECTS, lambda message, tracker: self.score.on_objects(tracker, message)),
            bus.subscribe(topics.SELECTION_EVENTS, self._on_event),
            bus.subscribe(topics.SELECTION, lambda state, _name: self.score.on_selection(state)),
            bus.subscribe(topics.INTERACTION, self._on_interaction, user_pattern),
            bus.subscribe(topics.POSE, self._on_pose, user_pattern),
            bus.subscribe(topics.LOCALIZATION, self._on_localization, user_pattern),
            bus.subscribe(topics.ANCHOR, self._on_anchor, user_pattern),
            bus.subscribe(topics.FEEDBACK, self._on_feedback, user_pattern),
            bus.subscribe(
                topics.PROFILE,
                lambda profile, user: self.colors.update({user: profile.cursor_color}),
                user_pattern,
            ),
            bus.subscribe(topics.HOVER, lambda hover, user: self.hovers.update({user: hover}), user_pattern),
            bus.subscribe(topics.LAMP_COLOR, lambda lamp, name: self.lamps.update({name: lamp})),
            bus.subscribe(topics.HEALTH, self._on_health),
            bus.subscribe(topics.CURSOR, self._on_cursor, user_pattern),
            bus.subscribe(topics.STRIPS_FRAME, self._on_frame),
            bus.watch(topics.USER_ALIVE, self._on_user),
            bus.watch(topics.SERVICE_ALIVE, self._on_service),
        ]
        for watcher in self.watchers:
            self._listening += watcher.attach(bus, self._add_event_of)

    def detach(self) -> None:
        """Unsubscribe; received data stays."""
        while self._listening:
            self._listening.pop().close()

    def people(self) -> list[str]:
        """Return the people whose activity is shown."""
        return sorted({*self.interactions, *self.cursors})

    def light_rates(self) -> dict[str, float]:
        """Return the mean frame rate of each controller's link by port, frames/s."""
        return {port: sum_hz / count for port, (sum_hz, count) in dict(self._light_hz).items()}

    def warnings(self) -> list[str]:
        """Return the services' last warnings, each prefixed with the instance."""
        return [f"{name}: {said}" for name, health in list(self.health.items()) for said in health.warnings]

    def refusal(self, user: str) -> str:
        """Return the reason of a person's last refusal, or `""` once they try again."""
        interaction = self.interactions.get(user)
        cue = self.cues.get(user, "")
        by_supervisor = cue if interaction is not None and cue == interaction.reason else ""
        return self.refusals.get(user, "") or by_supervisor

    def _add_event(self, text: str) -> None:
        line = one_line(text)
        self.events.append(line)
        if self.tell is not None:
            self.tell(line)

    def _add_event_of(self, text: str, user: str) -> None:
        if not self.person or user in ("", self.person):
            self._add_event(text)

    def _on_service(self, instance: str, present: bool) -> None:  # noqa: FBT001 - as above
        if instance == RECORDER:
            self.is_recorded = present
        for watcher in self.watchers:
            watcher.on_service(instance, is_present=present)

    def _on_user(self, user: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        if not present:  # all their services have ended, so their last state is outdated
            states = (self.cursors, self.hovers, self.interactions, self.poses, self.localizations)
            for newest in (*states, self.refusals, self.cues, self.colors):
                newest.pop(user, None)
            for instance in [name for name, health in self.health.items() if health.user == user]:
                del self.health[instance], self.heard_s[instance]

    def _on_map(self, environment: Environment, _name: str) -> None:
        self.environment = environment
        for watcher in self.watchers:
            watcher.on_map(environment)

    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        self.score.on_event(event)
        if event.event == "deselected" and not (event.cause or event.reason):
            return  # a button is over
        kind = self.score.kinds.get(event.object_id, "object")
        where = f" at bay {event.bay}" if event.bay else ""
        who = f"{where} by {event.user}" if event.user and not where else where
        room = self.environment
        has_label = room is not None and any(thing.id == event.object_id for thing in room.things)
        number = "" if has_label or event.object_id == kind else f" {event.object_id.rpartition('-')[2]}"
        reason = f": {event.reason}" if event.reason else ""
        if not self.person or event.user == self.person:
            self._add_event(f"{kind}{number} {event.event}{who}{reason}")

    def _on_interaction(self, interaction: Interaction, user: str) -> None:
        before = self.interactions.get(user)
        self.interactions[user] = interaction
        if before is not None and before.state == "idle" != interaction.state:
            self._try_again(user)
        begins = before is None and interaction.state == "idle" and not interaction.reason
        if not begins and (before is None or before.state != interaction.state):
            self._add_event(
                f"{user}: {interaction.state}. {interaction.reason or interaction.next_step}".rstrip()
            )

    def _on_pose(self, pose: UserPose, user: str) -> None:
        self.poses[user] = pose
        if pose.method == "fixed":  # given since then
            self.found.pop(user, None)
            return
        self._take_found(user)
        if user not in self.found or pose.method == "external":
            self.found[user] = pose

    def _take_found(self, user: str) -> None:
        """Store the pose of a finished localization; the two messages arrive in any order."""
        solved_ns, pose = self.solved.get(user), self.poses.get(user)
        if solved_ns is None or pose is None or pose.stamp_ns < solved_ns - TOGETHER_NS:
            return
        del self.solved[user]
        if pose.method in FOUND:
            self.found[user] = pose

    def _on_localization(self, localization: Localization, user: str) -> None:
        before = self.localizations.get(user)
        self.localizations[user] = localization
        if (
            localization.phase == "solved"
            and localization.purpose == "pose"
            and (before is None or before.phase != "solved")
        ):
            self.solved[user] = localization.stamp_ns
            self._take_found(user)
        if localization.phase in {"sampling", "solved"}:
            self._try_again(user)
        elif localization.phase == "refused" and localization.reason:
            self.refusals[user] = localization.reason

    def _on_anchor(self, anchor: Anchor, user: str) -> None:
        at = f" at {anchor.target_id}" if anchor.target_id else ""
        if anchor.accepted:
            off_deg = math.degrees(anchor.azimuth_error_rad)
            self._add_event(f"{user}: anchor{at}, the yaw was off by {off_deg:+.1f}°")
        else:
            self._add_event(f"{user}: anchor{at} rejected: {anchor.reason}".rstrip(": "))

    def _on_feedback(self, feedback: Feedback, user: str) -> None:
        if feedback.cue == "refused":
            self.cues[user] = feedback.text
        elif feedback.cue == "localized":
            self._try_again(user)

    def _try_again(self, user: str) -> None:
        self.refusals.pop(user, None)
        self.cues.pop(user, None)

    def _on_health(self, health: Health, instance: str) -> None:
        self.heard_s[instance] = time.monotonic()
        self.health[instance] = health
        for figure in health.figures:
            if figure.name.startswith(FRAME_RATE):
                port = figure.name.removeprefix(FRAME_RATE).strip()
                sum_hz, count = self._light_hz.get(port, (0.0, 0))
                self._light_hz[port] = (sum_hz + figure.value, count + 1)

    def _on_cursor(self, cursor: Cursor, user: str) -> None:
        self.cursors[user] = cursor
        if cursor.surface != "none" or cursor.solid:
            self.cursor_count += 1
            if self.first_cursor_unix_s is None:
                self.first_cursor_unix_s = time.time()
        if cursor.surface == "lamp":
            self.lamp_misses_rad[cursor.surface_id] = min(
                cursor.miss_rad, self.lamp_misses_rad.get(cursor.surface_id, math.inf)
            )
        self.latency.on_cursor(cursor)

    def _on_frame(self, frame: StripsFrame, _name: str) -> None:
        self.frame = frame
        self.frame_count += 1
        if self.first_frame_unix_s is None:
            self.first_frame_unix_s = time.time()
        self.latency.on_frame(frame, self.clock.now_ns(), self.clock.speed)
