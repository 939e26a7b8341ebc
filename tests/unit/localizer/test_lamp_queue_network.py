"""The queue of several localizers, whatever the network does: real cores with delays, losses and crashes.

Everybody points at one spot, whatever is lit: each localization takes its time, and is refused at the end.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

from hypothesis import given, settings
from hypothesis import strategies as st

from pointit.schemas import Environment, Lamp, Localization, PointingRay, SetPose
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation.estimator import Refusal
from pointit.services.localizer.outputs import LampSwitch, Output
from pointit.services.localizer.pose_manager import PoseManager
from pointit.services.localizer.procedures.lamp_queue import FRESH_S

S = 1_000_000_000
STEP_NS = S // 20
NAMES = ("anna", "ben", "carl", "dora", "emil")
LAMPS = tuple(
    Lamp(id=f"led_{number}", position_m=(float(number), 2.0 - number % 2, 1.0)) for number in range(4)
)
ROOM = Environment(stamp_ns=0, name="room", lamps=LAMPS)
LEFT, RIGHT, ALL = ("led_0", "led_1"), ("led_2", "led_3"), ()
MIDDLE = ("led_1", "led_2")
LOSS_S = 1.0
DELAY_S = 0.3
HOLD_S = 1.1
LASTS_S = 4 * (0.4 + HOLD_S) + 0.2
"""Longest duration of one localization."""


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
    lit: set[str] = field(default_factory=set[str])

    @property
    def points(self) -> bool:
        return bool(self.lit)

    @property
    def waits(self) -> bool:
        return self.core is not None and self.core.is_busy and not self.lit

    def shares(self, other: "Player") -> bool:
        mine, theirs = ({*player.lamps} or {lamp.id for lamp in LAMPS} for player in (self, other))
        return bool(mine & theirs)


class World:
    """Several localizers and the wires between them; time goes on in steps."""

    def __init__(self, lamps: Sequence[tuple[str, ...]], delays_s: Sequence[float]) -> None:
        self.now_ns = 1000 * S
        self.people = {
            name: Player(name, its, delay_s)
            for name, its, delay_s in zip(NAMES, lamps, delays_s, strict=False)
        }
        self.wire: list[tuple[int, int, str, str, Localization]] = []
        """When it arrives, in which order it was sent, from whom, to whom, what."""
        self.sent = 0
        self.together_ns = 0
        """For how long two who share lamps have pointed at them."""
        self.longest_ns = 0
        self.same_ns = 0
        """The same for two who point at one lamp, in all."""
        for player in self.people.values():
            self.boot(player)

    def boot(self, player: Player) -> None:
        config = LocalizerConfig(
            method="static_targets",
            order="given",
            lamps=player.lamps,
            reaction_s=0.4,
            hold_s=HOLD_S,
            patience_s=0.5,
            steady_degps=0.0,
        )
        player.core = PoseManager(player.name, config)
        self.emit(player, player.core.begin(self.now_ns))
        self.emit(player, player.core.on_map(ROOM, self.now_ns))
        player.core.set_pose(SetPose(position_m=(0.0, 0.0, 0.0)), self.now_ns)

    def crash(self, player: Player) -> None:
        """Without a word; lamps stay lit, but nobody points at them any more."""
        player.core, player.asked_ns = None, None
        player.lit.clear()

    def ask(self, player: Player, *, anchor: bool = False) -> None:
        if player.core is None or player.core.is_busy:
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
            if isinstance(output, LampSwitch):
                was_dark = not player.lit
                (player.lit.add if output.on else player.lit.discard)(output.lamp_id)
                if was_dark and player.lit and player.asked_ns is not None:
                    player.begun_ns.append(self.now_ns)
                    player.asked_ns = None
            elif isinstance(output, Localization):
                player.news = output
                assert not (output.ahead and output.target_id)
                assert player.name not in output.ahead
                self.send(player, output)

    def send(self, player: Player, news: Localization) -> None:
        for other in self.people.values():
            if other is not player:
                self.sent += 1
                at_ns = self.now_ns + round(other.delay_s * S)
                self.wire.append((at_ns, self.sent, player.name, other.name, news))

    def step(self) -> None:
        self.now_ns += STEP_NS
        arrived = sorted(item for item in self.wire if item[0] <= self.now_ns)
        self.wire = [item for item in self.wire if item[0] > self.now_ns]
        for _, _, sender, name, news in arrived:
            player = self.people[name]
            if player.core is not None and self.now_ns >= player.is_deaf_until_ns:
                self.emit(player, player.core.on_localization(news, sender, self.now_ns))
        ray = PointingRay(stamp_ns=self.now_ns, origin_m=(0.0, 0.0, 1.6), direction=(1.0, 0.0, 0.0))
        for player in self.people.values():
            if player.core is not None and player.core.is_busy:
                self.emit(player, player.core.on_ray(ray, self.now_ns))
                self.emit(player, player.core.step(self.now_ns))
        pairs = list(itertools.combinations([player for player in self.people.values() if player.lit], 2))
        self.together_ns = self.together_ns + STEP_NS if any(a.shares(b) for a, b in pairs) else 0
        self.longest_ns = max(self.longest_ns, self.together_ns)
        self.same_ns += STEP_NS if any(a.lit & b.lit for a, b in pairs) else 0

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
        return not any(player.core is not None and player.core.is_busy for player in self.people.values())


delays = st.lists(st.floats(0.0, DELAY_S), min_size=len(NAMES), max_size=len(NAMES))
areas = st.lists(st.sampled_from([LEFT, RIGHT]), min_size=2, max_size=len(NAMES))
SOME = settings(max_examples=60)


@SOME
@given(
    delays_s=delays,
    order=st.permutations(NAMES),
    gaps_s=st.lists(st.floats(0.0, 6.0), min_size=5, max_size=5),
    anchors=st.booleans(),
)
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
    assert world.longest_ns <= (DELAY_S * S) + 2 * STEP_NS  # who begins is heard, and who must, yields
    last = {player.name: player.begun_ns[-1] for player in world.people.values()}
    for (one_ns, one), (other_ns, other) in itertools.pairwise(asked):
        if other_ns - one_ns > 2 * DELAY_S * S:  # else nobody could know
            assert last[one] < last[other], (one, other)


@SOME
@given(areas, delays, st.data())
def test_every_wait_ends_despite_losses_and_crashes(
    lamps: list[tuple[str, ...]], delays_s: list[float], data: st.DataObject
) -> None:
    """Losses of a second now and then, processes that die and come back, people who cancel."""
    world = World(lamps, delays_s)
    people = list(world.people.values())
    for _ in range(12):
        player = data.draw(st.sampled_from(people))
        match data.draw(st.sampled_from(["ask", "ask", "anchor", "lose", "crash", "cancel"])):
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
            case "cancel":
                world.cancel(player)
            case _:
                pass
        world.run(data.draw(st.sampled_from([0.0, 0.1, 0.7, 2.0])))
    served_s = len(people) * (LASTS_S + DELAY_S + 1.0) + FRESH_S
    world.run_out(served_s)
    assert all(player.asked_ns is None or player.core is None or not player.waits for player in people)
    # a second is lost, the next word comes a second later and takes its way
    assert world.longest_ns <= (LOSS_S + 1.0 + DELAY_S) * S + 4 * STEP_NS


@SOME
@given(delays, st.floats(0.0, 1.0))
def test_disjoint_sets_of_lamps_are_used_side_by_side(delays_s: list[float], gap_s: float) -> None:
    world = World([LEFT, RIGHT], delays_s)
    anna, ben = world.people.values()
    world.ask(anna)
    world.run(gap_s)
    world.ask(ben)
    assert (anna.points, ben.points) == (True, True)
    world.run(1.5)
    assert (anna.points, ben.points) == (True, True)


@SOME
@given(
    st.lists(st.sampled_from([LEFT, MIDDLE, RIGHT, ALL]), min_size=2, max_size=4),
    delays,
    st.lists(st.floats(0.0, 3.0), min_size=4, max_size=4),
)
def test_of_sets_that_overlap_no_lamp_is_pointed_at_by_two(
    lamps: list[tuple[str, ...]], delays_s: list[float], gaps_s: list[float]
) -> None:
    """Nobody can know of a shared lamp before one of them points at it: then the later one yields."""
    world = World(lamps, delays_s)
    for player, gap_s in zip(world.people.values(), gaps_s, strict=False):
        world.ask(player)
        world.run(gap_s)
    world.run_out(2 * len(lamps) * LASTS_S)
    assert world.same_ns <= len(lamps) ** 2 * (DELAY_S * S + 2 * STEP_NS)


def test_who_waits_for_another_area_does_not_hold_up_this_one() -> None:
    world = World([LEFT, RIGHT, LEFT, RIGHT], [0.1] * len(NAMES))
    people = list(world.people.values())
    for player in people:
        world.ask(player)
        world.run(0.5)
    assert [player.points for player in people] == [True, True, False, False]
    assert [player.news.ahead for player in people if player.news] == [(), (), ("anna",), ("ben",)]
    world.cancel(people[1])
    world.run(0.3)
    assert [player.points for player in people] == [True, False, False, True]
