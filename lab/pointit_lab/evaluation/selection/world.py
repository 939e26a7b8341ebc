"""One trial in virtual time: the services' own cores with simulated people, without a bus.

Person → pointing → cursor → selector → lights → the person's eyes; packages move meanwhile. Frames are drawn
only when a person's eyes are due to look.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pointit.schemas import (
    NS_PER_S,
    Announced,
    Claim,
    Cursor,
    Environment,
    Feedback,
    Hover,
    ImuSample,
    Selection,
    SelectionEvent,
    TrackedObjects,
    UserPose,
    UserProfile,
)
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.light_state import LightState
from pointit.services.pointing.pointer import Pointer
from pointit.services.pointing.service import PointingConfig
from pointit.services.pui.cursor import PersonCursor
from pointit.services.pui.surfaces import Surfaces
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.selection_engine import SelectionEngine
from pointit.services.selector.selection_publisher import OutgoingMessage
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.person import SimulatedPerson

START_NS = 1_000 * NS_PER_S
"""Start time of a trial."""

TRACKER = "belts"


class ObjectMotion(Protocol):
    """Motion of the objects in the room."""

    def step(self, now_ns: int) -> list[SelectionEvent]:
        """Advance to `now_ns`. Return the events of objects that left or were dispatched."""
        ...

    def tracked(self, now_ns: int) -> TrackedObjects:
        """Return all objects."""
        ...

    def select(self, owners: dict[str, str]) -> None:
        """Update the selected objects and their owners."""
        ...


@dataclass(frozen=True, kw_only=True)
class Rates:
    """Rates in virtual time, Hz."""

    imu_hz: float = 25.0
    objects_hz: float = 10.0
    """Rate of a tracker's reports; positions in between are extrapolated by the speed."""
    eyes_hz: float = 10.0
    """Rate at which people look at the lights while they point; at most 30."""
    rest_hz: float = 5.0
    """The same while they do not point and look around."""


USUAL = Rates()


@dataclass(frozen=True, kw_only=True)
class TrialPerson:
    """A person of a trial."""

    name: str
    config: UserSimConfig
    profile: UserProfile


class World:
    """A room with moving objects and people, stepped in virtual time."""

    def __init__(
        self,
        environment: Environment,
        object_motion: ObjectMotion,
        people: Sequence[TrialPerson],
        *,
        surfaces: Surfaces,
        selector: SelectorConfig,
        seed: Sequence[int],
        rates: Rates,
    ) -> None:
        """Create the world with all people present and allowed to point.

        Args:
            environment: the map.
            object_motion: object motion, created for `START_NS`.
            people: people with different names.
            surfaces: surfaces of the map for pointing.
            selector: parameters of the dwell method.
            seed: seed of everything random about people.
            rates: rates of the simulation.
        """
        self.now_ns = START_NS
        self.frames = 0
        """Frames drawn so far."""
        self.entered_ns: dict[str, int] = {}
        """Time of each object's first appearance."""
        self._movers = object_motion
        self._selecting = SelectionEngine(selector, lambda _record: None)
        self._lights = LightState(LedDriverConfig())
        self._selecting.on_map(environment)
        self._lights.on_map(environment)

        # a generator for each person: their draws do not depend on what others do
        sequences = np.random.SeedSequence(list(seed)).spawn(len(people))
        self._people: list[_Present] = []
        for member, sequence in zip(people, sequences, strict=True):
            rng = np.random.default_rng(sequence)
            self._people.append(_Present(member, surfaces, rng))
        self._present: Mapping[str, _Present] = {present.name: present for present in self._people}
        self._step_ns = round(NS_PER_S / rates.imu_hz)
        self._objects_every_ns = round(NS_PER_S / rates.objects_hz)
        self._look_every_ns = round(NS_PER_S / rates.eyes_hz)
        self._rest_every_ns = round(NS_PER_S / rates.rest_hz)
        self._objects_ns = START_NS
        self._look_ns = START_NS

        # people see the map and that they may point, before the first step
        started = Feedback(stamp_ns=START_NS, cue="started")
        for present in self._people:
            present.person.see(START_NS, environment, "")
            present.person.see(START_NS, present.profile, present.name)
            present.person.see(START_NS, started, present.name)
            self._lights.content.set_profile(present.name, present.profile)
            self._selecting.set_present(present.name, True, START_NS)

    def step(self) -> list[SelectionEvent]:
        """Advance by one sample of the wrists. Return the events of objects."""
        now_ns = self.now_ns = self.now_ns + self._step_ns
        events: list[SelectionEvent] = []
        if now_ns >= self._objects_ns:
            self._objects_ns += self._objects_every_ns
            events += self._movers.step(now_ns)
            objects = self._movers.tracked(now_ns)
            for thing in objects.objects:
                self.entered_ns.setdefault(thing.id, now_ns)
            outputs = self._selecting.on_objects(TRACKER, objects)
            self._route(outputs, events)
            self._lights.content.set_objects(TRACKER, objects, now_ns)
            for present in self._people:
                present.person.see(now_ns, objects, TRACKER)
        for present in self._people:
            self._point(present, events)
        self._route(self._selecting.tick(now_ns), events)
        if now_ns >= self._look_ns:
            self._look()
        return events

    def _look(self) -> None:
        """Show the lights to the people who are due to look, and schedule their next look."""
        frame = self._lights.frame(self.now_ns)
        if frame is not None:
            self.frames += 1
            for present in self._people:
                present.person.see(self.now_ns, frame, "")
        is_pointed = any(present.person.goal.closed_loop for present in self._people)
        self._look_ns += self._look_every_ns if is_pointed else self._rest_every_ns

    def _point(self, present: "_Present", events: list[SelectionEvent]) -> None:
        now_ns = self.now_ns
        sample, press = present.person.step(now_ns)
        if press is not None:
            self._route(self._selecting.on_button(present.name, press), events)
        if sample is None:
            return
        cursor = present.cursor(sample, now_ns)
        if cursor is None:
            return
        self._lights.on_cursor(present.name, cursor, now_ns)
        self._route(self._selecting.on_cursor(present.name, cursor), events)
        cue = present.cue()
        if cue is not None:
            present.person.see(now_ns, cue, present.name)

    def _route(self, outputs: Sequence[OutgoingMessage], events: list[SelectionEvent]) -> None:
        """Deliver the selector's outputs to their receivers."""
        now_ns = self.now_ns
        for output in outputs:
            message = output.message
            match message:
                case Hover():
                    self._lights.content.set_hover(output.user, message, now_ns)
                case Selection():
                    self._lights.content.set_selection(message)
                    owners = {chosen.id: chosen.user for chosen in message.objects}
                    self._movers.select(owners)
                case SelectionEvent():
                    events.append(message)
                case Claim() | Announced():
                    pass  # of shards only, and for people who hear names
                case Feedback():
                    present = self._present.get(output.user)
                    if present is not None:
                        present.person.see(now_ns, message, output.user)


class _Present:
    """A person with their own band, ray and cursor."""

    def __init__(self, member: TrialPerson, surfaces: Surfaces, rng: np.random.Generator) -> None:
        self.name = member.name
        self.profile = member.profile
        self.person = SimulatedPerson(member.config, member.name, rng)
        pointing = PointingConfig()
        self._pointer = Pointer(
            member.profile, stale_after_s=pointing.stale_after_s, one_euro=pointing.smoothing()
        )
        self._cursor = PersonCursor(surfaces)
        pose = UserPose(stamp_ns=START_NS, position_m=member.config.position_m, yaw_rad=self.person.yaw_rad)
        self._pointer.set_yaw(pose.yaw_rad)
        self._cursor.set_pose(pose)

    def cursor(self, sample: ImuSample, now_ns: int) -> Cursor | None:
        """Return the cursor of `sample`, if it makes one."""
        ray = self._pointer.ray(sample, now_ns)
        return None if ray is None else self._cursor.cursor(ray)

    def cue(self) -> Feedback | None:
        """Return the cue for pointing past everything, or None."""
        return self._cursor.cue()
