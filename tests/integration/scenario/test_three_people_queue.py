"""Three people are localized one after the other, virtual time: real supervisors, localizers and led-driver.

The people are played: they hear their cues and see lamps, nothing else; their rays are exact.
"""

import asyncio
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import pytest

from pointit.geometry.rotation import IDENTITY
from pointit.runtime.bus.contract import Bus
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.clock import START_NS, VirtualClock, run_virtually
from pointit.runtime.service.service import Launch, run_services
from pointit.schemas import NS_PER_S, ButtonEvent, Feedback, ImuSample, Interaction, LampColor, UserPose
from pointit.schemas.topics import BUTTON, FEEDBACK, IMU, INTERACTION, LAMP_COLOR, MAP, POSE, RAY
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.service import LedDriver
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.service import Localizer
from pointit.services.supervisor.config import SupervisorConfig
from pointit.services.supervisor.service import Supervisor
from tests.unit.localizer.person import PLACES, ROOM, Person

PEOPLE = {"anna": Person(1.5, 1.2, -2.0), "ben": Person(-0.5, 0.3, 1.0), "carl": Person(0.5, 1.6, 0.2)}
REACTION_S = 0.6
"""Until an arm is where a cue asked for it."""


@dataclass(frozen=True)
class How:
    """Times of the actions of one person, s."""

    press_at_s: tuple[float, ...]
    leaves_at_s: float = math.inf


@dataclass
class Wearer:
    """Somebody with a wristband, and their two services."""

    user: str
    bus: Bus
    clock: VirtualClock
    how: How
    cues: list[Feedback] = field(default_factory=list[Feedback])
    interactions: list[Interaction] = field(default_factory=list[Interaction])
    poses: list[UserPose] = field(default_factory=list[UserPose])

    def __post_init__(self) -> None:
        self.bus.subscribe(FEEDBACK, lambda cue, _user: self.cues.append(cue), self.user)
        self.bus.subscribe(INTERACTION, lambda now, _user: self.interactions.append(now), self.user)
        self.bus.subscribe(POSE, lambda pose, _user: self.poses.append(pose), self.user)

    @property
    def now_s(self) -> float:
        return (self.clock.now_ns() - START_NS) / NS_PER_S

    def at_s(self, cue: str) -> list[float]:
        return [(its.stamp_ns - START_NS) / NS_PER_S for its in self.cues if its.cue == cue]

    async def live(self) -> None:
        """Press when it is time, point at what was asked for last, and leave."""
        launches = [
            Launch(
                service=Localizer, config=LocalizerConfig(method="static_targets", targets=3), user=self.user
            ),
            Launch(service=Supervisor, config=SupervisorConfig(localize=True), user=self.user),
        ]
        services = asyncio.create_task(run_services(launches, self.bus, self.clock))
        buttons = self.bus.publisher(BUTTON, self.user)
        rays, wrist = self.bus.publisher(RAY, self.user), self.bus.publisher(IMU, self.user)
        presses = list(self.how.press_at_s)
        try:
            while self.now_s < self.how.leaves_at_s:
                await asyncio.sleep(0.02)
                now_ns = self.clock.now_ns()
                if presses and self.now_s >= presses[0]:
                    presses.pop(0)
                    buttons.put(ButtonEvent(stamp_ns=now_ns))
                wrist.put(ImuSample(stamp_ns=now_ns, orientation_xyzw=IDENTITY))
                rays.put(PEOPLE[self.user].ray(self._aim(now_ns), now_ns))
        finally:
            services.cancel()
            await asyncio.gather(services, return_exceptions=True)
            for publisher in (buttons, rays, wrist):
                publisher.close()

    def _aim(self, now_ns: int) -> tuple[float, float, float]:
        asked = ""
        for cue in self.cues:
            if now_ns - cue.stamp_ns >= REACTION_S * NS_PER_S:
                asked = cue.target_id
        return PLACES.get(asked, (1.0, 0.0, 1.0))


@dataclass
class Room:
    """State of the room that all people see."""

    wearers: dict[str, Wearer] = field(default_factory=dict[str, Wearer])
    lit: set[str] = field(default_factory=set[str])
    most_lit: int = 0

    def on_lamp(self, lamp: LampColor, name: str) -> None:
        (self.lit.add if any(lamp.color) else self.lit.discard)(name)
        self.most_lit = max(self.most_lit, len(self.lit))


async def _play(duration_s: float, people: Mapping[str, How]) -> Room:
    exchange = LocalBroker()
    bus = MemoryBus(exchange)
    clock = VirtualClock()
    room = Room()
    bus.subscribe(LAMP_COLOR, room.on_lamp)
    maps = bus.publisher(MAP)
    maps.put(ROOM)
    buses = [bus]
    for user, how in people.items():
        own = MemoryBus(exchange)
        buses.append(own)
        room.wearers[user] = Wearer(user, own, clock, how)
    lights = Launch(service=LedDriver, config=LedDriverConfig())
    lives = [
        asyncio.create_task(run_services([lights], bus, clock)),
        *(asyncio.create_task(wearer.live()) for wearer in room.wearers.values()),
    ]
    await asyncio.sleep(duration_s)
    for life in lives:
        life.cancel()
    for result in await asyncio.gather(*lives, return_exceptions=True):
        assert result is None or isinstance(result, asyncio.CancelledError), result
    for one in buses:
        await one.close()
    return room


def play(duration_s: float, **people: How) -> Room:
    return run_virtually(_play(duration_s, people))


def test_three_are_served_in_turn_and_hear_all_they_must_know() -> None:
    room = play(40.0, ben=How((1.0,)), carl=How((1.3,)), anna=How((1.6,)))
    assert room.most_lit == 1
    assert room.lit == set()
    found_s = dict[str, float]()
    for user, wearer in room.wearers.items():
        person = PEOPLE[user]
        assert math.dist(wearer.poses[-1].position_m[:2], (person.x, person.y)) < 0.1
        assert [cue.cue for cue in wearer.cues] == ["started", *["target"] * 3, "localized", "started"]
        assert [bool(cue.target_id) for cue in wearer.cues] == [cue.cue == "target" for cue in wearer.cues]
        found_s[user] = wearer.at_s("localized")[0]
    assert sorted(found_s, key=found_s.__getitem__) == ["ben", "carl", "anna"]
    for before, after in (("ben", "carl"), ("carl", "anna")):
        gap_s = room.wearers[after].at_s("target")[0] - found_s[before]
        assert 0.0 <= gap_s <= 0.1
    queues = [its.ahead for its in room.wearers["anna"].interactions if its.ahead]
    assert queues == [("ben", "carl"), ("carl",)]
    last = [its.next_step for its in room.wearers["anna"].interactions if its.ahead][-1]
    assert last.startswith("Wait: carl is pointing at the lamps, you are second;")


@pytest.mark.parametrize("leaves_at_s", [3.0, 0.0])
def test_who_leaves_in_the_midst_or_cancels_lets_the_next_begin(leaves_at_s: float) -> None:
    """The first one goes away while a lamp is lit for them, or presses again; the second one cancels."""
    ben = How((1.0,), leaves_at_s) if leaves_at_s else How((1.0, 3.0))
    room = play(20.0, ben=ben, carl=How((1.3, 2.0)), anna=How((1.6,)))
    carl, anna = room.wearers["carl"], room.wearers["anna"]
    assert [cue.cue for cue in carl.cues] == ["started", "stopped"]
    assert anna.at_s("target")[0] == pytest.approx(3.0, abs=0.15)
    assert anna.cues[-1].cue == "started"
    assert room.most_lit == 1
    assert room.lit == set()


def test_all_who_press_at_the_same_moment_are_served_one_after_the_other() -> None:
    room = play(60.0, **{user: How((1.0,)) for user in PEOPLE})
    for wearer in room.wearers.values():
        cues = [cue.cue for cue in wearer.cues]
        assert cues[0] == "started"
        assert cues[-5:] == [*["target"] * 3, "localized", "started"]
        assert all(cue.target_id for cue in wearer.cues[-5:-2])
        withdrawn = [cue for cue in wearer.cues if cue.cue == "target" and not cue.target_id]
        assert len(cues) == 6 + 2 * len(withdrawn)  # a lamp was lit, and then somebody was first
        assert wearer.interactions[-1].state == "pointing"
    found_s = sorted(wearer.at_s("localized")[0] for wearer in room.wearers.values())
    assert min(late - early for early, late in itertools.pairwise(found_s)) > 5.0
    assert room.lit == set()
