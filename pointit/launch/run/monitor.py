"""Observer of a run: the newest messages of every kind for the view and the summary, and its score.

An object that left at a bay counts for the person it was sent there for, whatever was selected before.
"""

import math
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pointit.launch.plan.plan import Watcher
from pointit.runtime.bus.contract import AnyTopic, Bus, Closable
from pointit.runtime.clock import Clock
from pointit.runtime.machine import this_machine
from pointit.schemas import (
    NS_PER_S,
    ActOutcome,
    Anchor,
    Cursor,
    Environment,
    Feedback,
    Health,
    Interaction,
    Localization,
    Selection,
    SelectionEvent,
    StripsFrame,
    TrackedObjects,
    UserPose,
    topics,
)
from pointit.schemas.problems import ROUTER_LOST
from pointit.schemas.text import one_line
from pointit.services.led_driver.outputs import FRAME_RATE
from pointit.services.registry import RECORDER, person_of
from pointit.site.following import follow_site
from pointit.site.site_state import Change, SiteState

UNKNOWN = "object"
"""Kind of an object that no tracker has listed."""
MAX_OBJECTS = 10_000
"""Objects stored individually. Beyond that, the oldest are only counted."""
MAX_TRACKERS = 64
"""Trackers stored. Beyond that, the one that has been silent longest is dropped."""
MAX_FAILURES = 20
"""Last failures of acts in the summary. Earlier ones are only counted."""
RECENT = 64
"""Recent cursors kept to match a frame with its capture."""
LATENCY_STEP = 1.005
"""Ratio of neighbouring histogram bins, which bounds the memory of long runs."""
MIN_S = 1e-6

LINES = 5
"""Recent events kept for the view."""
FOUND = ("static_targets", "moving_target")
"""Pose methods of localization by pointing."""
TOGETHER_NS = 500_000_000
"""Maximum age of a pose relative to its Localization: a pose is stamped with its newest ray."""


@dataclass
class RunScore:
    """Counts objects and selections; pure. Other threads may read it."""

    target_kinds: Sequence[str]
    """Kinds to select. If empty, anything may be selected and nothing has to be."""
    kinds: dict[str, str] = field(default_factory=dict[str, str])
    """Kind by object id, of every object seen."""
    selected: set[str] = field(default_factory=set[str])
    left: set[str] = field(default_factory=set[str])
    listed: dict[str, frozenset[str]] = field(default_factory=dict[str, frozenset[str]])
    """Objects now listed, by tracker."""
    corrected: Counter[str] = field(default_factory=Counter[str])
    """Wrong selections that were corrected before the object left, by object id."""
    unknown: set[str] = field(default_factory=set[str])
    """Selected but not listed by any tracker: left over from an earlier run, so not counted as errors."""
    refused: int = 0
    """Selections without effect: too late for the bay, or another person's object."""
    refusal: str = ""
    """Reason of the last refused selection."""
    bays: dict[str, str] = field(default_factory=dict[str, str])
    """Bay where an object left, by object id."""
    past: Counter[str] = field(default_factory=Counter[str])
    """Counts of dropped objects."""
    past_bays: Counter[tuple[str, str]] = field(default_factory=Counter[tuple[str, str]])
    """Counts of dropped objects by bay and kind."""

    def on_objects(self, tracker: str, message: TrackedObjects) -> None:
        """Update from the list of `tracker`."""
        # The tracker that is silent longest is evicted first, which bounds memory
        self.listed.pop(tracker, None)
        self.listed[tracker] = frozenset(thing.id for thing in message.objects)
        if len(self.listed) > MAX_TRACKERS:
            del self.listed[next(iter(self.listed))]

        # Objects that were selected before they were seen count from now on
        for thing in message.objects:
            self._add_object(thing.id, thing.kind)
            if thing.id in self.unknown:
                self.unknown.discard(thing.id)
                self.selected.add(thing.id)

    def on_event(self, event: SelectionEvent) -> None:
        """Count `event`."""
        self._add_object(event.object_id, event.kind)
        if event.event in {"selected", "deselected"} and event.object_id in self.bays:
            return  # the bay is final
        if event.event == "selected":
            self.selected.add(event.object_id)
        elif event.event == "deselected":
            self.selected.discard(event.object_id)
            if self.target_kinds and self.kinds.get(event.object_id) not in self.target_kinds:
                self.corrected[event.object_id] += 1
        elif event.event == "refused":
            self.refused += 1
            self.refusal = event.reason
        elif event.event in {"left", "dispatched"}:  # may arrive twice if its publisher was killed meanwhile
            self.left.add(event.object_id)
            if event.user:  # it left for them, whether this or the selection without it arrived first
                self.selected.add(event.object_id)
                del self.corrected[event.object_id]
            elif event.event == "dispatched":  # to the bay for the rest, whatever was selected
                self.selected.discard(event.object_id)
            if event.event == "dispatched":
                self.bays[event.object_id] = event.bay

    def on_selection(self, selection: Selection) -> None:
        """Update from the current selection: a restarted selector publishes no events for it.

        It may contain objects selected in the previous run that have not been seen again yet.
        """
        selected = {thing.id for thing in selection.objects if not thing.is_pending}
        known = selected & self.kinds.keys()
        self.unknown = selected - known
        still_listed = known - self.bays.keys()
        self.selected = still_listed | (self.selected & self.left)

    def _add_object(self, name: str, kind: str) -> None:
        if self.kinds.get(name, UNKNOWN) == UNKNOWN:
            self.kinds[name] = kind or UNKNOWN
        if len(self.kinds) > MAX_OBJECTS:
            self._remove_object(next(iter(self.kinds)))

    def _remove_object(self, name: str) -> None:
        kind = self.kinds.pop(name)
        self.past["corrected"] += self.corrected.pop(name, 0)
        is_target = kind in self.target_kinds or not self.target_kinds
        was_wanted = bool(self.target_kinds) and is_target
        if name in self.bays:
            self.past_bays[self.bays.pop(name), kind] += 1
        if name in self.selected:
            self.past["selected" if is_target else "wrong"] += 1
        elif was_wanted and name in self.left:
            self.past["missed"] += 1
        self.selected.discard(name)
        self.left.discard(name)

    def counts(self) -> dict[str, int]:
        """Return targets selected, missed (left unselected) and pending, and other objects selected.

        Pending are those still listed. Objects that vanished with their tracker or a reset do not count.
        """
        # Each is copied at one go, since another thread may call this
        kinds = dict(self.kinds)
        selected = set(self.selected)
        left = set(self.left)
        present = frozenset[str]().union(*list(self.listed.values()))
        targets = {name for name, kind in kinds.items() if kind in self.target_kinds}
        right = selected
        wrong: set[str] = set()
        if self.target_kinds:
            right = targets & selected
            wrong = selected - targets
        missed = (targets & left) - selected
        pending = (targets & present) - left - selected
        past = self.past
        return {
            "selected": past["selected"] + len(right),
            "missed": past["missed"] + len(missed),
            "pending": len(pending),
            "wrong": past["wrong"] + len(wrong),
            "corrected": past["corrected"] + sum(self.corrected.copy().values()),
        }

    def dispatched(self) -> dict[str, dict[str, int]]:
        """Return the number of objects that left, by bay and kind."""
        kinds = dict(self.kinds)
        bays = dict(self.bays)
        total = Counter(self.past_bays)
        current = [(bay, kinds.get(name, UNKNOWN)) for name, bay in bays.items()]
        total.update(current)
        counts: dict[str, dict[str, int]] = {}
        for (bay, kind), count in sorted(total.items()):
            counts.setdefault(bay, {})[kind] = count
        return counts


class Latency:
    """Time from capture at the wrist to the light that shows it, wall seconds. Other threads may read it."""

    def __init__(self) -> None:
        self._classes: Counter[int] = Counter()
        self._pending: dict[int, None] = {}

    def on_cursor(self, cursor: Cursor) -> None:
        """Store a capture that waits for its frame."""
        if cursor.surface == "none" and not cursor.solid:
            return
        # Captures whose frame never comes are evicted
        self._pending[cursor.stamp_ns] = None
        while len(self._pending) > RECENT:
            del self._pending[next(iter(self._pending))]

    def on_frame(self, frame: StripsFrame, now_ns: int, speed: float) -> None:
        """Count the first frame of a stored capture; `now_ns` runs `speed` times as fast as wall time."""
        if frame.stamp_ns in self._pending:
            del self._pending[frame.stamp_ns]
            value_s = (now_ns - frame.stamp_ns) / NS_PER_S / speed + frame.light_s
            step = round(math.log(max(value_s, MIN_S), LATENCY_STEP))
            self._classes[step] += 1

    @property
    def count(self) -> int:
        """Return the number of captures shown as light."""
        return sum(dict(self._classes).values())

    def quantiles_ms(self) -> dict[str, float | None]:
        """Return median and 99th percentile, ms, exact to 0.3 %; values are None if nothing was measured."""
        classes = sorted(dict(self._classes).items())
        total = sum(number for _, number in classes)
        if not total:
            return {"p50": None, "p99": None}

        def quantile(share: float) -> float:  # nearest rank
            rank = math.ceil(share * total)
            for exponent, number in classes:
                rank -= number
                if rank <= 0:
                    return round(LATENCY_STEP**exponent * 1e3, 3)
            raise AssertionError("unreachable: the ranks sum up to the total")

        return {"p50": quantile(0.5), "p99": quantile(0.99)}


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
    found: dict[str, UserPose] = field(default_factory=dict[str, UserPose])
    """Last poses found by pointing, also of people who have left."""
    solved: dict[str, int] = field(default_factory=dict[str, int])
    """Stamps of solved localizations whose pose has not arrived yet."""
    refusals: dict[str, str] = field(default_factory=dict[str, str])
    """Last refusal reason of the localizer by person, until they try again."""
    cues: dict[str, str] = field(default_factory=dict[str, str])
    """Text of the last refusal cue by person, until they try again; the selector also refuses."""
    events: deque[str] = field(default_factory=lambda: deque(maxlen=LINES))
    _results: Counter[str] = field(default_factory=Counter[str])
    """Number of final outcomes of acts: done, failed."""
    failures: deque[str] = field(default_factory=lambda: deque(maxlen=MAX_FAILURES))
    """Sentences on the last acts that failed."""
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

    def __post_init__(self) -> None:
        self.site = site = SiteState(self._on_change, on_person=self._on_user, on_service=self._on_service)
        self.cursors = site.all(topics.CURSOR)
        self.hovers = site.all(topics.HOVER)
        self.interactions = site.all(topics.INTERACTION)
        self.poses = site.all(topics.POSE)
        self.localizations = site.all(topics.LOCALIZATION)
        self.profiles = site.all(topics.PROFILE)
        self.lamps = site.all(topics.LAMP_COLOR)
        self.health = site.all(topics.HEALTH)
        # By topic. Other topics are not subscribed to.
        self._handlers: dict[AnyTopic, Callable[[Any, str, Any], None]] = {
            topics.MAP: self._on_map,
            topics.OBJECTS: self._on_objects,
            topics.SELECTION_EVENTS: self._on_event,
            topics.OUTCOMES: self._on_outcome,
            topics.SELECTION: self._on_selection,
            topics.INTERACTION: self._on_interaction,
            topics.POSE: self._on_pose,
            topics.LOCALIZATION: self._on_localization,
            topics.ANCHOR: self._on_anchor,
            topics.FEEDBACK: self._on_feedback,
            topics.PROFILE: _ignore,
            topics.HOVER: _ignore,
            topics.LAMP_COLOR: _ignore,
            topics.HEALTH: self._on_health,
            topics.CURSOR: self._on_cursor,
            topics.STRIPS_FRAME: self._on_frame,
        }

    def attach(self, bus: Bus) -> None:
        """Subscribe on `bus`; where one person is shown, to no one else's cursors and the like."""
        user = self.person or topics.ANY
        self._listening += follow_site(self.site, bus, time.monotonic, self._handlers, user)
        for watcher in self.watchers:
            self._listening += watcher.attach(bus, self._add_event_of)

    def detach(self) -> None:
        """Unsubscribe; received data stays."""
        while self._listening:
            self._listening.pop().close()

    @property
    def acts(self) -> Mapping[str, int]:
        """Number of acts by their last result: started, done, failed. Empty without acts."""
        started = self.site.act_results.pending
        if not started and not self._results:
            return {}
        return {"started": started, **self._results}

    def people(self) -> list[str]:
        """Return the people whose activity is shown."""
        return sorted({*self.interactions, *self.cursors})

    def light_rates(self) -> dict[str, float]:
        """Return the mean frame rate of each controller's link by port, frames/s."""
        sums = dict(self._light_hz)
        return {port: sum_hz / count for port, (sum_hz, count) in sums.items()}

    def warnings(self) -> list[str]:
        """Return the services' last warnings, each prefixed with the instance."""
        sentences: list[str] = []
        for name, health in list(self.health.items()):
            sentences += [f"{name}: {warning}" for warning in health.warnings]
        return sentences

    @property
    def lost_router(self) -> str:
        """Return the address of the router that a service has lost, or `""`."""
        for health in list(self.health.values()):
            for problem in health.problems:
                if problem.code == ROUTER_LOST:
                    return problem.subject
        return ""

    def lost(self, silent_s: float) -> set[str]:
        """Return services that have left, or have been silent for `silent_s`, but of people who have left."""
        now_s = time.monotonic()
        silent = set[str]()
        for name in list(self.health):
            received_s = self.site.received_s(topics.HEALTH, name) or now_s
            if now_s - received_s > silent_s:
                silent.add(name)
        people = ("", *self.site.people)
        return silent | {name for name in self.site.former_services if person_of(name) in people}

    def refusal(self, user: str) -> str:
        """Return the reason of a person's last refusal, or `""` once they try again."""
        interaction = self.interactions.get(user)
        cue = self.cues.get(user, "")
        refusal = self.refusals.get(user, "")
        if refusal:
            return refusal
        if interaction is None or cue != interaction.reason:
            return ""
        return cue

    def _add_event(self, text: str) -> None:
        line = one_line(text)
        self.events.append(line)
        if self.tell is not None:
            self.tell(line)

    def _add_event_of(self, text: str, user: str) -> None:
        if not self.person or user in ("", self.person):
            self._add_event(text)

    def _on_service(self, instance: str, present: bool) -> None:
        if instance == RECORDER:
            self.is_recorded = present
        for watcher in self.watchers:
            watcher.on_service(instance, is_present=present)

    def _on_user(self, user: str, present: bool) -> None:
        if not present:
            self._try_again(user)

    def _on_change(self, change: Change) -> None:
        if change.message is not None:
            self._handlers[change.topic](change.message, change.name, change.previous)

    def _on_map(self, environment: Environment, *_: object) -> None:
        self.environment = environment
        for watcher in self.watchers:
            watcher.on_map(environment)

    def _on_outcome(self, outcome: ActOutcome, *_: object) -> None:
        if outcome.result != "started":
            self._results[outcome.result] += 1
        if outcome.result == "failed":
            name = outcome.kind or outcome.object_id
            self.failures.append(f"{name}: {outcome.text}")

    def _on_event(self, event: SelectionEvent, *_: object) -> None:
        self.score.on_event(event)
        is_unexplained = not event.cause and not event.reason
        if event.event == "deselected" and is_unexplained:
            return  # a button is over
        kind = self.score.kinds.get(event.object_id, "object")
        preposition = "for" if event.event == "refused" else "by"
        origin = ""
        if event.bay:
            origin = f" at bay {event.bay}"
        elif event.user:
            origin = f" {preposition} {event.user}"

        # Objects of a tracker are numbered. Things of the map have a name that says enough.
        number = ""
        if event.object_id != kind and not self._has_label(event.object_id):
            suffix = event.object_id.rpartition("-")[2]
            number = f" {suffix}"
        reason = f": {event.reason}" if event.reason else ""
        if not self.person or event.user == self.person:
            name = f"{kind}{number}"
            self._add_event(f"{name} {event.event}{origin}{reason}")

    def _has_label(self, object_id: str) -> bool:
        """Return True for a thing of the map."""
        if self.environment is None:
            return False
        return any(thing.id == object_id for thing in self.environment.things)

    def _on_objects(self, objects: TrackedObjects, tracker: str, _: object) -> None:
        self.score.on_objects(tracker, objects)

    def _on_selection(self, selection: Selection, *_: object) -> None:
        self.score.on_selection(selection)

    def _on_interaction(self, interaction: Interaction, user: str, previous: Interaction | None) -> None:
        is_idle = interaction.state == "idle"
        if previous is None:
            has_changed = not is_idle or bool(interaction.reason)  # all begin idle
        else:
            has_changed = previous.state != interaction.state
            if previous.state == "idle" and not is_idle:
                self._try_again(user)
        if has_changed:
            explanation = interaction.reason or interaction.next_step
            self._add_event(f"{user}: {interaction.state}. {explanation}".rstrip())

    def _on_pose(self, pose: UserPose, user: str, _previous: UserPose | None) -> None:
        if pose.method == "fixed":  # given since then
            self.found.pop(user, None)
            return
        self._store_solution(user)
        if user not in self.found or pose.method == "external":
            self.found[user] = pose

    def _store_solution(self, user: str) -> None:
        """Store the pose of a finished localization; the two messages arrive in any order."""
        solved_ns = self.solved.get(user)
        pose = self.poses.get(user)
        if solved_ns is None or pose is None:
            return
        if pose.stamp_ns < solved_ns - TOGETHER_NS:
            return
        del self.solved[user]
        if pose.method in FOUND:
            self.found[user] = pose

    def _on_localization(self, localization: Localization, user: str, previous: Localization | None) -> None:
        is_solution = localization.phase == "solved" and localization.purpose == "pose"
        is_new = previous is None or previous.phase != "solved"
        if is_solution and is_new:
            self.solved[user] = localization.stamp_ns
            self._store_solution(user)
        if localization.phase in {"sampling", "solved"}:
            self._try_again(user)
        elif localization.phase == "refused" and localization.reason:
            self.refusals[user] = localization.reason

    def _on_anchor(self, anchor: Anchor, user: str, _previous: object) -> None:
        target = f" at {anchor.target_id}" if anchor.target_id else ""
        if anchor.accepted:
            error_deg = math.degrees(anchor.azimuth_error_rad)
            self._add_event(f"{user}: anchor{target}, the yaw was off by {error_deg:+.1f}°")
        else:
            sentence = f"{user}: anchor{target} rejected: {anchor.reason}"
            self._add_event(sentence.rstrip(": "))

    def _on_feedback(self, feedback: Feedback, user: str, _previous: object) -> None:
        if feedback.cue == "refused":
            self.cues[user] = feedback.text
        elif feedback.cue == "localized":
            self._try_again(user)

    def _try_again(self, user: str) -> None:
        self.refusals.pop(user, None)
        self.cues.pop(user, None)

    def _on_health(self, health: Health, *_: object) -> None:
        for figure in health.figures:
            if figure.name.startswith(FRAME_RATE):
                port = figure.name.removeprefix(FRAME_RATE).strip()
                sum_hz, count = self._light_hz.get(port, (0.0, 0))
                self._light_hz[port] = (sum_hz + figure.value, count + 1)

    def _on_cursor(self, cursor: Cursor, *_: object) -> None:
        if cursor.surface != "none" or cursor.solid:
            self.cursor_count += 1
            if self.first_cursor_unix_s is None:
                self.first_cursor_unix_s = this_machine().now_ns() / NS_PER_S
        if cursor.surface == "lamp":
            min_miss_rad = self.lamp_misses_rad.get(cursor.surface_id, math.inf)
            self.lamp_misses_rad[cursor.surface_id] = min(cursor.miss_rad, min_miss_rad)
        self.latency.on_cursor(cursor)

    def _on_frame(self, frame: StripsFrame, *_: object) -> None:
        self.frame = frame
        self.frame_count += 1
        if self.first_frame_unix_s is None:
            self.first_frame_unix_s = this_machine().now_ns() / NS_PER_S
        self.latency.on_frame(frame, self.clock.now_ns(), self.clock.speed)


def _ignore(*_: object) -> None:
    """Do nothing: the message is only held."""
