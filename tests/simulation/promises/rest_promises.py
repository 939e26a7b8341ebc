"""Promises of a site at rest: some time after the last fault, when nobody points."""

from collections.abc import Sequence

from pointit.diagnosis.observation import Finding
from pointit.schemas import StripsFrame, topics
from pointit.schemas.topics import Delivery
from pointit.site.site_state import SiteState
from tests.simulation.promises import promise
from tests.simulation.promises.breaches import Breaches
from tests.simulation.promises.history import History
from tests.simulation.world.room import LAMP_THINGS, SHELF_LENGTH_M, SHELF_PARTS_M
from tests.simulation.world.world import World

LIT_ABOVE = 90
"""Value of a channel above which a pixel shows more than the light of an unselected thing."""

MAX_WAY_S = 0.1
"""Time within which a message may still be on its way, s."""

View = dict[tuple[str, str], str]
"""A text for each topic key and name that an observer shows."""


class RestPromises:
    """Checks what everybody and everything shows."""

    def __init__(self, world: World, history: History, breaches: Breaches) -> None:
        self._world = world
        self._history = history
        self._breaches = breaches

    def check(self, observers: dict[str, SiteState], findings: Sequence[Finding]) -> None:
        """Check all. `findings` are those of `pointit doctor`."""
        self._check_switches()
        self._check_observers(observers)
        self._check_lamps()
        self._check_shelf()
        sentences = [f"{each.severity} {each.code} {each.service}: {each.sentence}" for each in findings]
        if sentences:
            self._breaches.add(promise.DOCTOR_IS_CONTENT, "; ".join(sentences))

    def _check_switches(self) -> None:
        selected = self._history.selected_things()
        for device in self._world.devices.values():
            is_selected = device.thing in selected
            if device.kind == "reporting" and device.is_on is not is_selected:
                state = "on" if device.is_on else "off"
                self._breaches.add(
                    promise.FOLLOWS_TARGET, f"{device} is {state}, and selected: {is_selected}"
                )

    def _check_observers(self, observers: dict[str, SiteState]) -> None:
        views = {name: _view(state) for name, state in observers.items()}
        first, *others = views
        for other in others:
            for key in sorted({*views[first], *views[other]}):
                texts = (views[first].get(key), views[other].get(key))
                if texts[0] != texts[1]:
                    text = f"{key[0]} {key[1]}: {first} {texts[0]}, {other} {texts[1]}"
                    self._breaches.add(promise.OBSERVERS_AGREE, text)
        for key, (process, message, at_s) in sorted(self._history.newest.items(), key=lambda item: item[0]):
            if self._world.simulation.now_s - at_s < MAX_WAY_S:
                continue
            shown = views[first].get(key)
            newest = f"{message.stamp_ns} {message.seq}"
            if shown is not None and shown != newest and not process.is_dead:
                text = f"{key[0]} {key[1]}: {shown} instead of {newest}"
                self._breaches.add(promise.OBSERVERS_ARE_CURRENT, text)

    def _check_lamps(self) -> None:
        for lamp, thing in LAMP_THINGS.items():
            newest = self._history.newest.get((topics.LAMP_COLOR.key, lamp))
            is_lit = newest is not None and any(newest[1].color)
            self._check_light(lamp, thing, is_lit=is_lit)

    def _check_shelf(self) -> None:
        newest = self._history.newest.get((topics.STRIPS_FRAME.key, ""))
        if newest is None:
            return
        frame: StripsFrame = newest[1]
        for strip in frame.strips:
            if strip.id != "shelf":
                continue
            pixels_per_m = len(strip.rgb) / 3 / SHELF_LENGTH_M
            for thing, (begin_m, end_m) in SHELF_PARTS_M.items():
                first = int(begin_m * pixels_per_m) + 1
                last = int(end_m * pixels_per_m) - 1
                is_lit = any(value > LIT_ABOVE for value in strip.rgb[3 * first : 3 * last])
                self._check_light(f"the part of {thing}", thing, is_lit=is_lit)

    def _check_light(self, light: str, thing: str, *, is_lit: bool) -> None:
        is_selected = thing in self._history.selected_things()
        if is_lit and not is_selected:
            self._breaches.add(promise.LIT_FOR_SOMEBODY, light)
        if is_selected and not is_lit:
            self._breaches.add(promise.SELECTED_IS_LIT, light)


def _view(state: SiteState) -> View:
    view: View = {}
    for topic in topics.TOPICS:
        if topic.delivery is Delivery.STATE:
            for name, message in state.all(topic).items():
                view[topic.key, name] = f"{message.stamp_ns} {message.seq}"
    for person in state.people:
        view["alive/users", person] = "present"
    for service in state.services:
        view["alive/services", service] = "present"
    return view
