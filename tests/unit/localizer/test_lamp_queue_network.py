"""The queue for lamps, whatever the network does: real cores of several localizers and of led-driver.

Each localization takes its time, and is refused at the end without solving for a pose.
"""

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas import Environment, Lamp, LampLeases, Localization, PointingRay, SetPose
from pointit.services.led_driver.lamps import MAX_LOCALIZATION_AGE_NS, LampQueue
from pointit.services.localizer import static_targets
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation.estimator import Refusal
from pointit.services.localizer.outputs import Output
from pointit.services.localizer.pose_manager import PoseManager

S = 1_000_000_000
STEP_NS = S // 20
NAMES = ("anna", "ben", "carl", "dora", "emil")
LAMPS = tuple(Lamp(id=f"led_{x}", position_m=(float(x), 2.0 - x % 2, 1.0)) for x in range(4))
ROOM = Environment(stamp_ns=0, name="room", lamps=LAMPS)
LEFT = ("led_0", "led_1")
RIGHT = ("led_2", "led_3")
ALL = ()
MIDDLE = ("led_1", "led_2")
LOSS_S = 1.0
DELAY_S = 0.3
HOLD_S = 1.1
CONFIG = LocalizerConfig(
    method="static_targets", order="given", reaction_s=0.4, hold_s=HOLD_S, patience_s=0.5, steady_degps=0.0
)
LASTS_S = 4 * (0.4 + HOLD_S) + 0.2
"""Longest duration of one localization."""


@pytest.fixture(autouse=True)
def is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_of: object, **_at: object) -> Refusal:
        return Refusal("the rays miss the lamps", 0.5)

    monkeypatch.setattr(static_targets, "held", refuse)


@dataclass
class Player:
    """One person's localizer, and how it is heard."""

    name: str
    lamps: tuple[str, ...]
    delay_s: float = 0.0
    is_deaf_until_ns: int = 0
    core: PoseManager | None = None
    news: Localization | None = None
    asked_ns: int | None = None
    begun_ns: list[int] = field(default_factory=list[int])

    @property
    def target(self) -> str:
        """The lamp that the person points at, or `""`."""
        return self.news.target_id if self.core is not None and self.news is not None else ""

    @property
    def waits(self) -> bool:
        return self.core is not None and self.core.procedures.is_busy and not self.target

    def shares(self, other: "Player") -> bool:
        mine, theirs = ({*player.lamps} or {lamp.id for lamp in LAMPS} for player in (self, other))
        return bool(mine & theirs)


class World:
    """Several localizers, one led-driver and the wires between them; time goes on in steps."""

    def __init__(self, lamps: Sequence[tuple[str, ...]], delays_s: Sequence[float]) -> None:
        self.now_ns = 1000 * S
        self.people = {
            name: Player(name, its, delay_s)
            for name, its, delay_s in zip(NAMES, lamps, delays_s, strict=False)
        }
        self.wire: list[tuple[int, int, str, Localization | LampLeases]] = []
        """When it arrives, in which order it was sent, by or to whom, what."""
        self.sent = 0
        self.queue = LampQueue(60 * S)
        self.leases = LampLeases(stamp_ns=0)
        self.together_ns = Counter[tuple[str, str]]()
        """For how long two who share lamps have pointed at them, by their names."""
        self.longest_ns = 0
        self.same_ns = 0
        """The same for two who point at one lamp, in all."""
        for player in self.people.values():
            self.boot(player)

    def boot(self, player: Player) -> None:
        player.core = PoseManager(player.name, CONFIG.model_copy(update={"lamps": player.lamps}))
        self.emit(player, player.core.begin(self.now_ns))
        self.emit(player, player.core.on_map(ROOM, self.now_ns))
        player.core.set_pose(SetPose(position_m=(0.0, 0.0, 0.0)), self.now_ns)

    def crash(self, player: Player) -> None:
        """Without a word."""
        player.core = None
        player.asked_ns = None

    def restart_led_driver(self) -> None:
        """It gets the last word of each localizer, as these are states."""
        self.queue = LampQueue(60 * S)
        for player in self.people.values():
            if player.core is not None and player.news is not None:
                self.send(player, player.news)

    def ask(self, player: Player, *, anchor: bool = False) -> None:
        if player.core is None or player.core.procedures.is_busy:
            return
        player.asked_ns = self.now_ns
        answer = player.core.point_anchor("", self.now_ns) if anchor else player.core.start(None, self.now_ns)
        assert not isinstance(answer, Refusal)
        self.emit(player, answer.outputs)

    def cancel(self, player: Player) -> None:
        if player.core is not None:
            self.emit(player, player.core.cancel(self.now_ns).outputs)

    def emit(self, player: Player, outputs: Sequence[Output]) -> None:
        for output in outputs:
            if isinstance(output, Localization):
                assert not (output.ahead and output.target_id)
                assert player.name not in output.ahead
                player.news = output
                if output.target_id and player.asked_ns is not None:
                    player.begun_ns.append(self.now_ns)
                    player.asked_ns = None
                self.send(player, output)

    def send(self, player: Player, news: Localization | LampLeases) -> None:
        self.sent += 1
        self.wire.append((self.now_ns + round(player.delay_s * S), self.sent, player.name, news))

    def step(self) -> None:
        self.now_ns += STEP_NS
        arrived = sorted(item for item in self.wire if item[0] <= self.now_ns)
        self.wire = [item for item in self.wire if item[0] > self.now_ns]
        for _, number, name, news in arrived:
            player = self.people[name]
            if isinstance(news, Localization):
                self.queue.on_localization(name, news, self.now_ns)
            elif self.now_ns < player.is_deaf_until_ns:  # states are sent again when the link is back
                self.wire.append((player.is_deaf_until_ns, number, name, news))
            elif player.core is not None:
                self.emit(player, player.core.procedures.on_leases(news, self.now_ns))
        self.queue.expire(self.now_ns)
        leases = self.queue.service().leases
        if leases != self.leases.leases:
            self.leases = LampLeases(stamp_ns=self.now_ns, leases=leases)
            for player in self.people.values():
                self.send(player, self.leases)
        ray = PointingRay(stamp_ns=self.now_ns, origin_m=(0.0, 0.0, 1.6), direction=(1.0, 0.0, 0.0))
        for player in self.people.values():
            if player.core is not None and player.core.procedures.is_busy:
                self.emit(player, player.core.on_ray(ray, self.now_ns))
                self.emit(player, player.core.procedures.step(self.now_ns))
        pairs = list(itertools.combinations([player for player in self.people.values() if player.target], 2))
        sharing = [(a.name, b.name) for a, b in pairs if a.shares(b)]
        self.together_ns = Counter({pair: self.together_ns[pair] + STEP_NS for pair in sharing})
        self.longest_ns = max([self.longest_ns, *self.together_ns.values()])
        self.same_ns += STEP_NS if any(a.target == b.target for a, b in pairs) else 0

    def run(self, duration_s: float) -> None:
        for _ in range(round(duration_s * S / STEP_NS)):
            self.step()

    def run_out(self, limit_s: float) -> None:
        """Go on until nobody points or waits and nothing is on its way, which must be within `limit_s`."""
        for _ in range(round(limit_s * S / STEP_NS)):
            if self.rests() and not self.wire:
                return
            self.step()
        assert self.rests()

    def rests(self) -> bool:
        return not any(
            player.core is not None and player.core.procedures.is_busy for player in self.people.values()
        )


delays = st.lists(st.floats(0.0, DELAY_S), min_size=len(NAMES), max_size=len(NAMES))
areas = st.lists(st.sampled_from([LEFT, RIGHT]), min_size=2, max_size=len(NAMES))


@given(
    delays_s=delays, order=st.permutations(NAMES),
    gaps_s=st.lists(st.floats(0.0, 6.0), min_size=5, max_size=5), anchors=st.booleans(),
)  # fmt: skip
def test_first_come_is_first_served_and_never_two_at_once(
    delays_s: list[float], order: list[str], gaps_s: list[float], *, anchors: bool
) -> None:
    world = World([ALL] * len(NAMES), delays_s)
    asked: list[tuple[int, str]] = []
    for name, gap_s in zip(order, gaps_s, strict=True):
        world.ask(world.people[name], anchor=anchors and name < "c")
        asked.append((world.now_ns, name))
        world.run(gap_s)
    world.run_out(len(NAMES) * (LASTS_S + 1.0))
    # who begins is heard by led-driver, and who must, yields
    assert world.longest_ns <= (2 * DELAY_S * S) + 3 * STEP_NS
    last = {player.name: player.begun_ns[-1] for player in world.people.values()}
    for (one_ns, one), (other_ns, other) in itertools.pairwise(asked):
        if other_ns - one_ns > 2 * DELAY_S * S:  # else nobody could know
            assert last[one] < last[other], (one, other)


@given(areas, delays, st.data())
def test_every_wait_ends_despite_losses_and_crashes(
    lamps: list[tuple[str, ...]], delays_s: list[float], data: st.DataObject
) -> None:
    """Losses of a second now and then, processes and led-driver that die and come back, people who cancel."""
    world = World(lamps, delays_s)
    people = list(world.people.values())
    for _ in range(12):
        player = data.draw(st.sampled_from(people))
        match data.draw(st.sampled_from(["ask", "ask", "anchor", "lose", "crash", "restart", "cancel"])):
            case "ask":
                world.ask(player)
            case "anchor":
                world.ask(player, anchor=True)
            case "lose" if world.now_ns >= player.is_deaf_until_ns + 2 * S:
                player.is_deaf_until_ns = world.now_ns + round(LOSS_S * S)
            case "crash" if player.core is not None:
                world.crash(player)
            case "crash":
                world.boot(player)
            case "restart":
                world.restart_led_driver()
            case "cancel":
                world.cancel(player)
            case _:
                pass
        world.run(data.draw(st.sampled_from([0.0, 0.1, 0.7, 2.0])))

    served_s = len(people) * (LASTS_S + DELAY_S + 1.0) + MAX_LOCALIZATION_AGE_NS / S
    world.run_out(served_s)
    assert all(player.asked_ns is None or player.core is None or not player.waits for player in people)
    # a second is lost; who is not heard for three has ended for led-driver
    assert world.longest_ns <= (LOSS_S + 1.0 + 2 * DELAY_S) * S + 4 * STEP_NS


@given(
    st.lists(st.sampled_from([LEFT, MIDDLE, RIGHT, ALL]), min_size=2, max_size=4),
    delays,
    st.lists(st.floats(0.0, 3.0), min_size=4, max_size=4),
)
def test_overlapping_sets_of_lamps_have_one_person_a_lamp(
    lamps: list[tuple[str, ...]], delays_s: list[float], gaps_s: list[float]
) -> None:
    """The later of two people who ask at once yields."""
    world = World(lamps, delays_s)
    for player, gap_s in zip(world.people.values(), gaps_s, strict=False):
        world.ask(player)
        world.run(gap_s)
    world.run_out(2 * len(lamps) * LASTS_S)
    assert world.same_ns <= len(lamps) ** 2 * (2 * DELAY_S * S + 3 * STEP_NS)


def test_people_waiting_for_another_area_do_not_delay_this_one() -> None:
    world = World([LEFT, RIGHT, LEFT, RIGHT], [0.1] * len(NAMES))
    people = list(world.people.values())
    for player in people:
        world.ask(player)
        world.run(0.5)
    assert [bool(player.target) for player in people] == [True, True, False, False]
    assert [player.news.ahead for player in people if player.news] == [(), (), ("anna",), ("ben",)]
    world.cancel(people[1])
    world.run(0.3)
    assert [bool(player.target) for player in people] == [True, False, False, True]
