"""Beliefs of simulated people, and things with lights."""

import math

import numpy as np
import pytest

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    BodyMeasures,
    ButtonEvent,
    Environment,
    Feedback,
    Hover,
    Lamp,
    LampColor,
    Strip,
    Thing,
    TrackedObject,
    UserProfile,
)
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.light_state import LightState
from pointit.services.pui.tracked_objects import listing
from pointit.services.user_sim.config import AimConfig, UserSimConfig
from pointit.services.user_sim.correction import Correction
from pointit.services.user_sim.eyes import ObservedAppearance
from pointit.services.user_sim.goal import ButtonModel, PerceivedState, PersonGoal, State
from pointit.services.user_sim.perceived_objects import PerceivedObjects, Status
from pointit.services.user_sim.perception import Perception
from pointit.services.user_sim.sight import Sight
from pointit.sim.aim import Stance
from tests.support import there
from tests.unit.user_sim.life import PRECISE, Cue, Life

WHITE = (255, 255, 255)
GREEN = (0, 158, 115)
JAR: Vec3 = (2.2, 0.6, 1.0)
ROOM = Environment(
    stamp_ns=0,
    name="kitchen",
    strips=(Strip(id="board", line_m=((2.2, 1.3, 1.6), (2.2, -1.3, 1.6)), pixels=120),),
    lamps=(Lamp(id="bulb", position_m=(0.5, 2.5, 1.4)),),
    things=(
        Thing(id="jar", center_m=JAR, size_m=(0.2, 0.2, 0.3), strip="board", part_m=(0.3, 0.9)),
        Thing(id="tin", center_m=(2.2, -0.6, 1.0), size_m=(0.2, 0.2, 0.3), strip="board", part_m=(1.5, 2.1)),
        Thing(id="table", center_m=(0.5, 2.5, 1.0), size_m=(0.2, 0.2, 0.2), lamp="bulb"),
        Thing(id="oven", center_m=(2.2, -2.0, 0.8), size_m=(0.6, 0.6, 1.6)),
    ),
)
STEP_NS = NS_PER_S // 50
NEXT = PersonGoal("next", point_m=JAR, closed_loop=True)
"""A goal with a cursor, which shows what was learned."""


class Look:
    """Perception of the room by a person whose hand is where it was aimed."""

    def __init__(self, color: tuple[int, int, int] = GREEN) -> None:
        profile = UserProfile(stamp_ns=0, cursor_color=color)
        self.now_ns = NS_PER_S
        self.sight = Sight(0.0)
        self.correction = Correction(
            AimConfig(skill=1.0, correction_spread=0.0), Stance(BodyMeasures()), np.random.default_rng(1)
        )
        self.perception = Perception(self.sight, self.correction)
        self.lights = LightState(LedDriverConfig())
        self.lights.on_map(ROOM)
        self.lights.content.set_profile("anna", profile)
        for message in (ROOM, profile, Feedback(stamp_ns=0, cue="started")):
            self.sight.show(self.now_ns, message)
        self.goal = NEXT

    def aim(self, name: str) -> None:
        self.run(0.02, NEXT)
        item = self.thing(name)
        self.goal = PersonGoal(
            f"object {name}", item.position_m, closed_loop=True, object_id=name, on_line=False, lit=item.lit
        )
        self.correction.settle(NEXT, self.goal)
        self.correction.begin(self.now_ns)

    def thing(self, name: str) -> TrackedObject:
        return next(item for item in listing(ROOM, self.now_ns).objects if item.id == name)

    def hover(self, name: str) -> None:
        hover = Hover(stamp_ns=self.now_ns, object_id=name, progress=0.2)
        self.lights.content.set_hover("anna", hover, self.now_ns)

    def run(self, duration_s: float, goal: PersonGoal | None = None) -> None:
        for _ in range(round(duration_s * 50)):
            self.now_ns += STEP_NS
            tracked = listing(ROOM, self.now_ns)
            self.lights.content.set_objects("things", tracked, self.now_ns)
            frame = there(self.lights.frame(self.now_ns))
            self.sight.show(self.now_ns, tracked, "things")
            self.sight.show(self.now_ns, frame)
            self.sight.look(self.now_ns)
            self.perception.update(self.now_ns, goal or self.goal)
            self.correction.step(self.now_ns)
            self.correction.remember(self.now_ns, (0.0, 0.0))

    def looks(self, name: str) -> ObservedAppearance:
        return there(self.sight.looks(there(self.sight.find(name, self.now_ns))))

    def learned_rad(self) -> tuple[float, float]:
        self.correction.settle(self.goal, NEXT)
        return self.correction.now_rad


@pytest.mark.parametrize("color", [WHITE, GREEN])
def test_margins_of_a_light_are_no_cursor(
    color: tuple[int, int, int],
) -> None:
    look = Look(color)
    look.aim("jar")
    look.hover("jar")
    look.run(0.3)
    assert look.sight.eyes.cursor("strip") is None
    jar = look.looks("jar")
    tin = look.looks("tin")
    assert (jar.own, tin.own, tin.marked) == (True, False, False)


@pytest.mark.parametrize("color", [WHITE, GREEN])
def test_hand_stays_while_the_distant_light_of_the_goal_answers(
    color: tuple[int, int, int],
) -> None:
    look = Look(color)
    look.aim("jar")
    for _ in range(10):
        look.hover("jar")
        look.run(0.2)
    assert look.correction.now_rad == pytest.approx((0.0, 0.0))
    assert look.learned_rad() == pytest.approx((0.0, 0.0))


def test_light_of_another_thing_corrects_the_hand_to_the_goal() -> None:
    look = Look()
    look.aim("jar")
    look.hover("tin")
    look.run(0.4)
    eyes_m = Stance(BodyMeasures()).eyes_m
    apart = 2.0 * vector.azimuth(vector.subtract(JAR, eyes_m))
    assert look.correction.now_rad[0] == pytest.approx(0.9 * apart)
    assert look.learned_rad() == (0.0, 0.0)  # nothing confirmed it yet


def test_lamp_of_the_goal_answers_in_the_own_colour_only() -> None:
    look = Look()
    look.aim("table")
    for color, is_searching in (((0, 0, 90), True), ((0, 79, 57), False)):
        look.correction.begin(look.now_ns)
        look.sight.show(look.now_ns, LampColor(stamp_ns=0, color=color), "bulb")
        look.run(1.5)
        assert (look.correction._searches > 0) == is_searching


def test_searches_are_not_learned() -> None:
    look = Look()
    for _ in range(20):
        look.aim("jar")
        look.run(1.2)  # nothing answers: one search
        assert look.correction.now_rad != (0.0, 0.0)
        look.correction.settle(look.goal, NEXT)
        assert look.correction.now_rad == (0.0, 0.0)


def test_hand_does_not_search_where_no_light_would_answer() -> None:
    look = Look()
    look.aim("oven")
    look.run(3.0)
    assert look.correction.now_rad == (0.0, 0.0)


def test_cue_about_another_thing_leads_past_it_to_the_goal() -> None:
    look = Look()
    look.aim("jar")
    look.run(0.2)
    cue = Feedback(stamp_ns=look.now_ns, cue="target", target_id="tin", turn_rad=(0.0, math.radians(10.0)))
    look.sight.show(look.now_ns, cue)
    look.run(0.1)
    apart = 2.0 * vector.azimuth(vector.subtract(JAR, Stance(BodyMeasures()).eyes_m))
    assert look.correction.now_rad == pytest.approx((apart, math.radians(10.0)), abs=1e-6)
    assert look.learned_rad()[1] > math.radians(3.0)


def test_selection_of_another_thing_is_understood_by_its_name() -> None:
    look = Look()
    look.aim("oven")
    look.run(0.2)
    look.sight.show(look.now_ns, Feedback(stamp_ns=look.now_ns, cue="selected", text="tin selected"))
    look.run(0.02)
    assert (look.perception.things.status("tin"), look.perception.things.status("oven")) == ("mine", "free")


WAIT = "Wait for a target to point at. Press the button to cancel."
Heard = tuple[Cue, str, str]
STARTED: Heard = ("started", "Point with your arm straight.", "")
WAITING: Heard = ("started", WAIT, "")
AT_LED: Heard = ("target", "Point at led_1.", "led_1")


def after(*heard: Heard) -> PerceivedState:
    perceived = PerceivedState()
    for number, (cue, text, target) in enumerate(heard):
        perceived.on_cue(
            Feedback(stamp_ns=0, cue=cue, text=text, target_id=target, waits="wait" in text.lower()),
            number * NS_PER_S,
        )
    return perceived


@pytest.mark.parametrize(
    ("heard", "state", "target"),
    [
        ((), "idle", ""),
        ((STARTED,), "pointing", ""),
        ((WAITING,), "asked", ""),
        ((WAITING, AT_LED), "asked", "led_1"),
        ((AT_LED,), "asked", "led_1"),
        ((WAITING, AT_LED, ("localized", "", "")), "idle", ""),
        ((WAITING, AT_LED, ("localized", "", ""), STARTED), "pointing", ""),
        ((WAITING, AT_LED, ("refused", "", "")), "idle", ""),
        ((STARTED, WAITING, AT_LED, ("localized", "", "")), "pointing", ""),
        ((STARTED, AT_LED, ("refused", "", "")), "pointing", ""),
        ((STARTED, AT_LED, ("localized", "", ""), ("stopped", "", "")), "idle", ""),
        ((STARTED, AT_LED, ("stopped", "", "")), "pointing", ""),
        ((STARTED, ("stopped", "", "")), "idle", ""),
        ((STARTED, ("selected", "", ""), ("refused", "", ""), ("deselected", "", "")), "pointing", ""),
    ],
)
def test_cues_tell_where_one_is(heard: tuple[Heard, ...], state: State, target: str) -> None:
    perceived = after(*heard)
    assert (perceived.state, perceived.target) == (state, target)


def test_person_in_a_queue_waits_for_their_turn() -> None:
    queuing = after(WAITING, ("target", "Wait: ben is pointing at the lamps, you are next.", ""))
    assert queuing.is_queuing
    assert queuing.state == "asked"
    queuing.on_cue(Feedback(stamp_ns=0, cue="target", text="Point at led_1.", target_id="led_1"), 0)
    assert not queuing.is_queuing


def test_press_that_stopped_unknown_pointing_is_repeated() -> None:
    """A late start misses `started`: the press then stops pointing, and the next one starts it again."""
    life = Life(PRECISE)
    life.run(4.5)
    assert len(life.presses) == 1
    life.cue("stopped")
    life.run(6.0)
    assert len(life.presses) == 2
    life.cue("started")
    life.run(20.0)
    assert len(life.presses) == 2


def pressed(
    press: ButtonModel, perceived: PerceivedState, from_s: float, to_s: float, *, sees: bool | None
) -> list[ButtonEvent]:
    events = [
        press.step(round(step / 10 * NS_PER_S), perceived, known_ns=0, sees=sees)
        for step in range(round(from_s * 10), round(to_s * 10))
    ]
    return [event for event in events if event is not None]


def test_person_presses_when_no_cursor_is_seen_for_long() -> None:
    perceived = after(STARTED)
    press = ButtonModel(UserSimConfig())
    assert pressed(press, perceived, 0.0, 20.0, sees=True) == []
    assert pressed(press, perceived, 20.0, 26.0, sees=False) == []
    assert pressed(press, perceived, 26.0, 60.0, sees=None) == []  # resting meanwhile
    assert pressed(press, perceived, 60.0, 65.7, sees=False) == []
    (event,) = pressed(press, perceived, 65.7, 67.0, sees=False)
    assert event.gesture == "press"
    assert perceived.state == "idle"
    never = ButtonModel(UserSimConfig(lost_press_s=0.0))
    assert pressed(never, after(STARTED), 0.0, 100.0, sees=False) == []


S = 1_000_000_000
PLAIN = ObservedAppearance(marked=False, full=False, hidden=False, own=False, foreign=False)
FULL_OWN = ObservedAppearance(marked=True, full=True, hidden=False, own=True, foreign=False)
FULL_FOREIGN = ObservedAppearance(marked=True, full=True, hidden=False, own=False, foreign=True)
HELD = ObservedAppearance(marked=True, full=False, hidden=False, own=False, foreign=True)


def seen(
    things: PerceivedObjects, looks: ObservedAppearance, duration_s: float, since_s: float = 1.0
) -> Status:
    for step in range(round(duration_s * 10) + 1):
        things.see("a", looks, round((since_s + step / 10) * S))
    return things.status("a")


@pytest.mark.parametrize(
    ("looks", "status"), [(FULL_OWN, "mine"), (FULL_FOREIGN, "theirs"), (HELD, "taken")], ids=str
)
def test_status_is_believed_when_seen_long_enough(looks: ObservedAppearance, status: Status) -> None:
    things = PerceivedObjects()
    assert seen(things, looks, 1.0) == status
    assert seen(things, PLAIN, 0.2, since_s=3.0) == "free"


def test_status_of_a_covered_thing_is_believed_later() -> None:
    things = PerceivedObjects()
    covered = FULL_OWN._replace(hidden=True)
    assert seen(things, covered, 0.4) == "free"
    assert seen(things, PLAIN, 0.1, since_s=2.0) == "free"
    assert seen(things, covered, 0.4, since_s=3.0) == "free"  # the time starts again
    assert seen(things, covered, 0.7, since_s=4.0) == "mine"


@pytest.mark.parametrize("status", ["mine", "theirs"])
def test_selected_thing_under_cursors_keeps_its_owner(status: Status) -> None:
    things = PerceivedObjects()
    things.believe("a", status, S)
    assert seen(things, FULL_FOREIGN._replace(own=True), 3.0, since_s=2.0) == status


def test_unclear_things_change_no_status_and_memory_is_bounded() -> None:
    things = PerceivedObjects()
    things.believe("a", "mine", S)
    things.see("a", None, 5 * S)
    assert things.status("a") == "mine"
    for number in range(10_100):
        things.believe(f"{number}", "mine", S)
    assert things.status("a") == "free"
