"""Things with lights of their own: the light says that the ray is on the thing, and is no cursor."""

import math

import numpy as np
import pytest

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    BodyMeasures,
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
from pointit.services.user_sim.config import AimConfig
from pointit.services.user_sim.correction import Correction
from pointit.services.user_sim.eyes import ObservedAppearance
from pointit.services.user_sim.goal import PersonGoal
from pointit.services.user_sim.perceived_objects import Sight
from pointit.services.user_sim.perception import Perception
from pointit.sim.aim import Stance
from tests.support.known import known

WHITE, GREEN = (255, 255, 255), (0, 158, 115)
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
        self.perception = Perception(self.sight, self.correction, 0.1)
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
            frame = self.lights.frame(self.now_ns)
            assert frame is not None
            self.sight.show(self.now_ns, tracked, "things")
            self.sight.show(self.now_ns, frame)
            self.sight.look(self.now_ns)
            self.perception.update(self.now_ns, goal or self.goal)
            self.correction.step(self.now_ns)
            self.correction.remember(self.now_ns, (0.0, 0.0))

    def looks(self, name: str) -> ObservedAppearance:
        seen = self.sight.find(name, self.now_ns)
        assert seen is not None
        return known(self.sight.looks(seen))

    def learned_rad(self) -> tuple[float, float]:
        self.correction.settle(self.goal, NEXT)
        return self.correction.now_rad


@pytest.mark.parametrize("color", [WHITE, GREEN])
def test_margins_of_a_things_light_are_no_cursor_though_things_are_as_white(
    color: tuple[int, int, int],
) -> None:
    look = Look(color)
    look.aim("jar")
    look.hover("jar")
    look.run(0.3)
    assert look.sight.eyes.cursor("strip") is None
    jar, tin = look.looks("jar"), look.looks("tin")
    assert (jar.own, tin.own, tin.marked) == (True, False, False)


@pytest.mark.parametrize("color", [WHITE, GREEN])
def test_hand_stays_while_the_light_of_the_goal_answers_though_it_shines_elsewhere(
    color: tuple[int, int, int],
) -> None:
    look = Look(color)
    look.aim("jar")
    for _ in range(10):
        look.hover("jar")
        look.run(0.2)
    assert look.correction.now_rad == pytest.approx((0.0, 0.0))
    assert look.learned_rad() == pytest.approx((0.0, 0.0))


def test_light_of_another_thing_turns_the_hand_from_it_to_the_goal() -> None:
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


def test_nothing_is_searched_for_where_no_light_would_answer() -> None:
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
