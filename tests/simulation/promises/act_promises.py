"""Promises of acts: what is told as done or failed, what is carried out, and when."""

import collections
from typing import Any

from pointit.runtime.bus.contract import AnyTopic
from pointit.schemas import topics
from pointit.schemas.topics import Request
from tests.simulation.kernel.process import START_NS, Process
from tests.simulation.promises import promise
from tests.simulation.promises.breaches import Breaches
from tests.simulation.promises.history import ActNumber, History, ToldEvent
from tests.simulation.world.devices import LIMIT_S, Deed
from tests.simulation.world.room import SWITCHES
from tests.simulation.world.world import World

MAX_ACT_AGE_S = 6.0
SLACK_S = 0.35
"""Time for the way of a message, and of a process that is about to begin, s."""
GOES_BACK_S = 0.5
EFFECTS = ("selected", "deselected")


class ActPromises:
    """Checks outcomes, cues, replies and what devices are told."""

    def __init__(self, world: World, history: History, breaches: Breaches, *, are_clocks_right: bool) -> None:
        """Check times only where `are_clocks_right`."""
        self._world = world
        self._history = history
        self._breaches = breaches
        self._are_clocks_right = are_clocks_right
        self._begun = collections.Counter[tuple[str, ActNumber]]()
        """Number of times that each device began each act."""
        for device in world.devices.values():
            device.on_deed.append(self._on_deed)
        world.operator.on_reply.append(self._on_reply)

    def on_put(self, _process: Process, topic: AnyTopic, name: str, message: Any) -> None:
        """Check an outcome or a cue. The history has it already."""
        if topic is topics.OUTCOMES:
            self._check_outcome(message)
        elif topic is topics.FEEDBACK:
            self._check_cue(name, message)

    def _lacking(self, told: ToldEvent) -> list[str]:
        """Return the carriers that have not done the act of an event."""
        event = told.event
        number = (event.object_id, event.stamp_ns)
        lacking: list[str] = []
        for carrier in event.carriers:
            device = self._world.device(carrier, event.object_id)
            if device is None or device.is_on is event.is_on:
                continue
            if not any(deed.act == number and deed.result == "done" for deed in device.deeds):
                lacking.append(carrier)
        return lacking

    def _check_outcome(self, outcome: Any) -> None:
        told = self._history.events.get((outcome.object_id, outcome.event_ns))
        if told is None:
            self._breaches.add(promise.KNOWN_OUTCOME, f"{outcome!r}")
            return
        results = {each.result for _, each in told.outcomes if each.result != "started"}
        if len(results) > 1:
            self._breaches.add(promise.ONE_RESULT, f"{outcome.object_id}: {sorted(results)}")
        lacking = self._lacking(told)
        if outcome.result == "done" and lacking:
            self._breaches.add(promise.DONE_IS_DONE, f"{outcome.object_id}: not by {lacking}")
        is_switch = outcome.object_id in SWITCHES and not told.event.takes_back
        if is_switch and outcome.result == "failed" and outcome.code != "replaced":
            self._world.simulation.after(GOES_BACK_S, self._check_goes_back, told)

    def _check_goes_back(self, told: ToldEvent) -> None:
        """Check that a later event follows one that failed, unless a target reports what it wanted."""
        event = told.event
        if told.process.is_dead or told.process.is_still:
            return
        for device in self._world.devices.values():
            if device.thing == event.object_id and device.kind == "reporting" and device.is_on is event.is_on:
                return
        is_selected = event.object_id in self._history.selected_things()
        if is_selected is event.is_on and self._history.newest_event(event.object_id) is told:
            text = f"{event.seq} {event.event} {event.object_id} of {event.user}"
            self._breaches.add(promise.GOES_BACK, text)

    def _check_cue(self, user: str, cue: Any) -> None:
        words = cue.text.split()
        if cue.cue == "refused" or len(words) != 2 or words[1] not in EFFECTS:
            return
        newest: ToldEvent | None = None
        for told in self._history.events.values():
            if told.event.object_id == words[0] and not told.event.takes_back:
                newest = told
        if newest is None or newest.event.event != words[1] or newest.has_succeeded:
            return
        lacking = self._lacking(newest)
        if lacking:
            self._breaches.add(promise.CUE_AFTER_DONE, f"{user}: {cue.text}, not by {lacking}")

    def _on_reply(
        self, began_s: float, request: Request[Any, Any], query: Any, _user: str, text: str
    ) -> None:
        if request is not topics.SET_THING or not text.startswith("ok: "):
            return
        if "already" in text or "result" in text:
            return
        effect = "deselected" if f"{query.thing} deselected" in text else "selected"
        newest: ToldEvent | None = None
        for told in self._history.events.values():
            is_meant = told.event.object_id == query.thing and told.event.event == effect
            if is_meant and told.at_s >= began_s:
                newest = told
        if newest is not None and not newest.has_succeeded and self._lacking(newest):
            self._breaches.add(promise.REPLY_AFTER_DONE, f"{query.thing}: {text}")

    def _on_deed(self, deed: Deed) -> None:
        device = deed.device
        name = f"{device} for {deed.act[1] % 10**12}"
        self._begun[str(device), deed.act] += 1
        if self._begun[str(device), deed.act] > 1:
            self._breaches.add(promise.NOT_TWICE, name)
        told = self._history.events.get(deed.act)
        if told is None:
            self._breaches.add(promise.ONLY_TOLD, name)
            return
        named = [self._world.device(carrier, deed.act[0]) for carrier in told.event.carriers]
        if device not in named:
            self._breaches.add(
                promise.ONLY_TOLD, f"{name}: it names {' '.join(told.event.carriers) or 'nobody'}"
            )
        if deed.takes_back or not self._are_clocks_right:
            return
        now_s = self._world.simulation.now_s
        age_s = now_s - (deed.act[1] - START_NS) / 1e9
        if age_s > MAX_ACT_AGE_S + self._waited_s(deed) + SLACK_S:
            self._breaches.add(promise.NOT_LATE, f"{name}: {age_s:.2f} s old")
        for at_s, outcome in told.outcomes:
            is_over = outcome.result == "failed" and outcome.code != "replaced"
            if is_over and now_s - at_s > SLACK_S:
                self._breaches.add(promise.FAILED_IS_OVER, f"{name}: {now_s - at_s:.2f} s after it was told")

    def _waited_s(self, deed: Deed) -> float:
        """Return the longest time that a carrier can have waited for the end of an earlier act, s."""
        earlier = [each for each in deed.device.deeds if each is not deed]
        if not earlier or deed.began_s - earlier[-1].began_s > LIMIT_S + SLACK_S:
            return 0.0
        return LIMIT_S

    def check_at_rest(self) -> None:
        """Check that each act has ended."""
        for told in self._history.events.values():
            event = told.event
            if not event.carriers or event.takes_back:
                continue
            if all(outcome.result == "started" for _, outcome in told.outcomes):
                text = f"{event.seq} {event.event} {event.object_id} of {event.user} at {told.at_s:.2f} s"
                self._breaches.add(promise.OUTCOME_FOLLOWS, f"{text} has none")
        selection = self._history.selection
        for each in () if selection is None else selection.objects:
            if each.is_pending:
                self._breaches.add(promise.NOT_PENDING, f"{each.id} of {each.user}")
