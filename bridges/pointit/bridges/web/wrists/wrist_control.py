"""Who has each person's wrist, the mouse of a page or a phone, and the samples that come of it."""

import math
from dataclasses import dataclass, field
from typing import Literal

from pointit.bridges.web.config import WebConfig
from pointit.bridges.web.model.assumed_pose import AssumedPose, choose_pose, middle
from pointit.bridges.web.wire import AimAt, AssumedPlace, Mover, PersonLine, Turn
from pointit.bridges.web.wrists.mouse_arm import MouseArm
from pointit.schemas import (
    NS_PER_S,
    Environment,
    Localization,
    UserPose,
    UserProfile,
    WristSample,
)

STILL_S = 0.18
"""A phone that has said nothing for so long holds still, and that is said: five times a second at least."""

SILENT_S = 1.0
"""A phone that has said nothing for so long, not even that it is still, has let go."""

MOST_TREMOR_DEG = 5.0

MOST_SESSIONS = 16
"""Of one person's phones that are told apart; the oldest are forgotten."""

Hold = Literal["mouse", "phone"]


@dataclass(slots=True)
class _Phone:
    """What a phone has said."""

    heard_ns: int
    turn: Turn
    session: int


@dataclass(slots=True)
class _Person:
    """One person's wrist."""

    standing: AssumedPose
    arm: MouseArm
    page: str = ""
    """Who has it; empty: nobody here."""
    by: Hold = "mouse"
    sent_ns: int = 0
    seq: int = 0
    phones: dict[str, _Phone] = field(default_factory=dict[str, _Phone])
    """By page."""
    lost: set[str] = field(default_factory=set[str])
    """Phones from which somebody else took it: they ask before they have it again."""
    sessions: dict[tuple[str, int], int] = field(default_factory=dict[tuple[str, int], int])
    """By page and the phone's own number: ours, the time of its first sample, so that none comes twice."""


class WristControl:
    """Of each person: which page has their wrist, and what it does.

    One page at a time; the last that takes it has it. All times are the site's, ns.
    """

    def __init__(self, config: WebConfig) -> None:
        """Begin with nobody."""
        self._config = config
        self._people: dict[str, _Person] = {}
        self._stand = choose_pose(Environment(stamp_ns=0, name=""))
        self._middle = middle(Environment(stamp_ns=0, name=""))

    # What the bus says.

    def profile(self, user: str, profile: UserProfile) -> None:
        """Take a person's measures."""
        self._person(user).arm.set_profile(profile)

    def pose(self, user: str, pose: UserPose) -> None:
        """Take where a person stands."""
        person = self._person(user)
        person.standing.pose(pose)
        person.arm.set_pose(*person.standing.at)

    def localization(self, user: str, progress: Localization) -> None:
        """Take how far a person's localization has come."""
        person = self._person(user)
        person.standing.localization(progress)
        person.arm.set_pose(*person.standing.at)

    def room(self, room: Environment) -> None:
        """Take the map."""
        self._stand, self._middle = choose_pose(room), middle(room)
        for person in self._people.values():
            person.standing.room(self._stand)
            person.arm.set_pose(*person.standing.at)

    # Who has it.

    def acquire(self, user: str, page: str, by: Hold) -> str:
        """Give the wrist of `user` to `page`; return the page that has lost it, empty where none has."""
        person = self._person(user)
        loser = "" if person.page == page else person.page
        if loser and person.by == "phone":
            person.lost.add(loser)
        person.lost.discard(page)
        person.page, person.by, person.sent_ns = page, by, 0
        return loser

    def release_from(self, user: str, page: str) -> bool:
        """Take the wrist of `user` back from `page`. Return True if it had it."""
        person = self._people.get(user)
        if person is None or person.page != page:
            return False
        if person.by == "phone":
            person.lost.add(page)  # it goes on saying how it is held: that is no wish to have it again
        self._free(person)
        return True

    def release(self, user: str) -> str:
        """Take the wrist of `user` back from whoever has it; return the page that had it, if any."""
        page = self.holder(user)[0]
        if page:
            self.release_from(user, page)
        return page

    def close(self, page: str) -> list[str]:
        """Take back what `page` has, which is gone for now or for ever; return whose wrists it had."""
        had = [user for user, person in self._people.items() if person.page == page]
        for user in had:
            self._free(self._people[user])
        return had

    def forget(self, user: str) -> None:
        """Forget a person who is gone."""
        self._people.pop(user, None)

    def holder(self, user: str) -> tuple[str, Mover]:
        """Return which page has the wrist of `user`, and what moves it; none has: empty and `own`."""
        person = self._people.get(user)
        return ("", "own") if person is None or not person.page else (person.page, person.by)

    # What it does.

    def aim(self, page: str, aim: AimAt) -> bool:
        """Point where the mouse of `page` does. Return True if it has that wrist."""
        person = self._people.get(aim.user)
        if person is None or person.page != page or person.by != "mouse":
            return False
        person.arm.aim(aim.at_m)
        return True

    def set_tremor(self, user: str, page: str, rms_deg: float) -> bool:
        """Let the arm that the mouse of `page` moves tremble. Return True if it has that wrist."""
        if self.holder(user) != (page, "mouse"):
            return False
        self._person(user).arm.set_tremor(math.radians(min(max(rms_deg, 0.0), MOST_TREMOR_DEG)))
        return True

    def turn(self, user: str, page: str, turn: Turn, now_ns: int) -> WristSample | None:
        """Take how the phone `page` of `user` is held; return the sample to publish, if it has the wrist.

        A phone takes the wrist by saying something, but for one that has lost it to somebody.
        """
        person = self._person(user)
        session = person.sessions.setdefault((page, turn.session), now_ns)
        while len(person.sessions) > MOST_SESSIONS:
            del person.sessions[next(iter(person.sessions))]
        person.phones[page] = _Phone(now_ns, turn, session)
        if not person.page and page not in person.lost:
            person.page, person.by = page, "phone"
        if person.page != page:
            return None
        return self._sample(person, now_ns)

    def step(self, now_ns: int, speed: float = 1.0) -> list[tuple[str, WristSample]]:
        """Return the samples that are due: of every arm a mouse moves, of phones that hold still.

        Phones that are silent let go. `speed`: how fast the site's time runs, whose wall people live by.
        """
        due: list[tuple[str, WristSample]] = []
        for user, person in self._people.items():
            if not person.page:
                continue
            if person.by == "mouse":
                due.append((user, self._sample(person, now_ns)))
                continue
            phone = person.phones.get(person.page)
            if phone is None or now_ns - phone.heard_ns > SILENT_S * speed * NS_PER_S:
                self._free(person)
            elif now_ns - person.sent_ns >= STILL_S * NS_PER_S:
                due.append((user, self._sample(person, now_ns)))
        return due

    def ahead(self, user: str) -> float:
        """Return the arm's azimuth in {H}, rad, that points at the middle of the map."""
        return self._person(user).arm.azimuth(self._middle)

    def line(self, user: str, page: str, now_ns: int, *, paired: str = "") -> PersonLine:
        """Return what `page` is told of `user`; `paired`: the page id of the phone that is paired."""
        holder, mover = self.holder(user)
        person = self._person(user)
        phone = person.phones.get(paired) if paired else None
        place = person.standing.assumed
        if not paired:
            said = ""
        elif phone is None:
            said = "waiting for the phone"
        elif now_ns - phone.heard_ns > SILENT_S * NS_PER_S:
            said = "paired, but silent"
        else:
            said = "moves the arm" if holder == paired else "connected, does not move the arm"
        return PersonLine(
            user=user,
            moved_by=mover,
            is_mine=bool(page) and holder == page,
            assumed=None if place is None else AssumedPlace(position_m=place[0], yaw_rad=place[1]),
            phone=said,
            battery=None if phone is None else phone.turn.battery,
        )

    def _person(self, user: str) -> _Person:
        person = self._people.get(user)
        if person is None:
            standing = AssumedPose(self._config.places.get(user))
            standing.room(self._stand)
            person = _Person(standing, MouseArm(seed=len(self._people)))
            person.arm.set_pose(*standing.at)
            self._people[user] = person
        return person

    def _sample(self, person: _Person, now_ns: int) -> WristSample:
        person.sent_ns = now_ns
        person.seq += 1
        if person.by == "mouse":
            return WristSample(stamp_ns=now_ns, seq=person.seq, orientation_xyzw=person.arm.step(now_ns))
        phone = person.phones[person.page]
        return WristSample(
            stamp_ns=now_ns,
            seq=person.seq,
            orientation_xyzw=phone.turn.q,
            device="phone",
            session=phone.session,
            device_time_ns=round(phone.turn.t_ms * 1e6),
            battery=phone.turn.battery,
        )

    def _free(self, person: _Person) -> None:
        person.page = ""
