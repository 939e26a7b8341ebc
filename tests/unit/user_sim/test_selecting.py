"""Choice of the next thing, deselection of mistakes, respect for other people's objects; lapses."""

from typing import Literal

import pytest

from pointit.schemas import (
    NS_PER_S,
    Announced,
    Bay,
    Belt,
    BeltLink,
    Environment,
    Hover,
    Lamp,
    SelectedObject,
    Selection,
    TrackedObject,
    TrackedObjects,
    UserProfile,
)
from pointit.services.led_driver.light_state import LightState
from pointit.services.user_sim.config import DecisionConfig, UserSimConfig
from pointit.services.user_sim.sight import SeenObject, Sight
from tests.unit.user_sim.life import PRECISE, Life, living, thing

GREEN = (0, 158, 115)
PINK = (204, 121, 167)


def at_work(*things: TrackedObject, lit: bool = False) -> Life:
    life = living("pointing", *things)
    if lit:
        life.light(profile=UserProfile(stamp_ns=0, cursor_color=GREEN))
    return life


def choice(life: Life, duration_s: float = 1.0) -> str:
    life.run(duration_s)
    return life.person.goal.key


def select(life: Life, **owners: str) -> None:
    assert life.lights is not None
    life.lights.content.set_profile("ben", UserProfile(stamp_ns=0, cursor_color=PINK))
    objects = tuple(SelectedObject(id=name, user=user, since_ns=0) for name, user in owners.items())
    life.lights.content.set_selection(Selection(stamp_ns=0, objects=objects))


def test_object_that_leaves_first_is_chosen_if_time_suffices() -> None:
    life = at_work(
        thing("gone", "red", 4.9, 0.25),
        thing("second", "red", 1.5, 0.25),
        thing("first", "red", 2.5, 0.25),
        thing("blue", "blue", 3.0, 0.25),
    )
    assert choice(life) == "object first"
    life.cue("selected")  # felt, while pointing at it
    assert choice(life) == "object second"
    life.cue("selected")
    assert choice(life) == "rest"
    life.cue("deselected")


def decided(name: str, along_m: float, at_s: float) -> TrackedObject:
    return thing(name, "red", along_m, 0.25).model_copy(update={"bay_until_ns": round(at_s * NS_PER_S)})


def test_object_past_its_deadline_is_not_chosen() -> None:
    life = at_work(decided("gone", 2.5, 0.0), decided("soon", 2.0, 1.5), decided("later", 1.5, 60.0))
    assert choice(life) == "object later"


@pytest.mark.parametrize(("along_m", "speed_mps"), [(0.0, 0.1), (5.0, -0.1)])
def test_object_that_is_still_entering_is_not_chosen_yet(along_m: float, speed_mps: float) -> None:
    life = at_work()
    life.before_step = lambda: life.objects(
        thing("a", "red", along_m + speed_mps * life.now_ns / NS_PER_S, speed_mps)
    )
    assert choice(life, 2.9) == "rest"
    assert choice(life, 0.6) == "object a"


def test_selected_object_is_recognized_and_skipped() -> None:
    life = at_work(thing("r", "red", 1.0), thing("s", "red", 4.0), lit=True)
    first, other = {"object r": ("r", "s"), "object s": ("s", "r")}[choice(life)]
    select(life, **{other: "ben"})
    life.run(1.0)
    select(life, **{other: "ben", first: "anna"})
    life.cue("selected")
    assert choice(life, 3.0) == "rest"
    select(life, **{other: "ben"})
    assert choice(life, 3.0) == f"object {first}"  # it was not selected after all


def test_accidental_selection_is_undone_and_those_of_others_are_kept() -> None:
    life = at_work(
        thing("b", "blue", 2.0),
        thing("o", "blue", 3.0),
        thing("r", "red", 1.0),
        thing("t", "red", 4.5),
        lit=True,
    )
    life.run(2.0)
    select(life, r="ben", t="ben", b="anna", o="ben")
    keys = {choice(life, 0.5) for _ in range(12)}
    assert "object b" in keys
    assert "object o" not in keys
    assert choice(life, 4.0) == "object b"


def test_object_that_another_person_is_selecting_is_skipped_meanwhile() -> None:
    life = at_work(thing("r", "red", 1.0), lit=True)
    assert choice(life) == "object r"
    assert life.lights is not None
    lights: LightState = life.lights
    lights.content.set_profile("ben", UserProfile(stamp_ns=0, cursor_color=PINK))

    def ben_holds() -> None:
        life.objects(thing("r", "red", 1.0))
        hover = Hover(stamp_ns=life.now_ns, object_id="r", progress=0.1, action="select")
        lights.content.set_hover("ben", hover, life.now_ns)

    life.before_step = ben_holds
    assert choice(life, 2.0) == "rest"
    assert {choice(life, 0.2) for _ in range(5)} == {"rest"}


HALL = Environment(
    stamp_ns=0,
    name="hall",
    belts=(
        Belt(id="in", line_m=((0.0, 0.0, 1.0), (4.0, 0.0, 1.0))),
        Belt(id="on", line_m=((4.0, 0.0, 1.0), (4.0, 6.0, 1.0))),
        Belt(id="off", line_m=((4.0, 2.0, 1.0), (2.0, 2.0, 1.0))),
    ),
    links=(BeltLink(source="in", target="on"), BeltLink(source="on", source_position_m=2.0, target="off")),
    bays=(Bay(id="1", belt="off"), Bay(id="3", belt="on")),
)


def on_belt(belt: str, along_m: float) -> SeenObject:
    moved = {"surface": "belt", "surface_id": belt, "surface_position_m": along_m, "surface_speed_mps": 0.5}
    return SeenObject(thing("p", "red", along_m).model_copy(update=moved), 0)


@pytest.mark.parametrize(
    ("deadlines", "belt", "along_m", "left_s"),
    [
        ({}, "in", 1.0, (3.0 + 2.0) / 0.5),
        ({}, "on", 1.0, 1.0 / 0.5),
        ({}, "on", 3.0, -1.0 / 0.5),
        ({}, "off", 0.5, 1.5 / 0.5),
        ({"on": 1.2}, "in", 1.0, (3.0 + 1.2) / 0.5),
        ({"in": 3.0}, "in", 1.0, 2.0 / 0.5),
        ({"in": 3.0}, "on", 1.0, 5.0 / 0.5),
    ],
)
def test_time_is_left_until_the_point_of_no_return(
    deadlines: dict[str, float], belt: str, along_m: float, left_s: float
) -> None:
    sight = Sight(0.0, deadlines)
    sight.show(0, HALL)
    sight.look(0)
    seen = on_belt(belt, along_m)
    assert sight.time_left_s(seen, 0) == pytest.approx(left_s)
    told = seen.thing.model_copy(update={"bay_until_ns": NS_PER_S})
    assert sight.time_left_s(SeenObject(told, 0), 0) == pytest.approx(min(left_s, 1.0))
    assert sight.has_come(on_belt("on", 0.1), 0)  # it was on another belt before
    assert not sight.has_come(on_belt("in", 0.1), 0)


def clumsy(share: float, skill: float = 0.0) -> UserSimConfig:
    mind = DecisionConfig(lapse_share=share)
    aim = PRECISE.aim.model_copy(update={"skill": skill})
    return PRECISE.model_copy(update={"mind": mind, "aim": aim})


def test_lapse_selects_another_object_and_never_at_full_skill() -> None:
    keys: dict[float, str] = {}
    for skill in (0.0, 1.0):
        life = Life(clumsy(1.0, skill))
        life.state("pointing")
        life.before_step = lambda life=life: life.objects(thing("a", "red", 2.0), thing("b", "blue", 2.5))
        keys[skill] = choice(life, 1.3)
    assert keys == {0.0: "object b", 1.0: "object a"}


def test_person_rests_in_an_empty_room() -> None:
    for behaviour in ("lamps", "strips", "select"):
        life = Life(PRECISE.model_copy(update={"behaviour": behaviour}))
        life.person.see(0, Environment(stamp_ns=0, name="empty"))
        life.state("pointing")
        assert choice(life, 2.0) == "rest"
        lamp = Lamp(id="l", position_m=(3.0, 0.0, 0.0))
        life.person.see(life.now_ns, Environment(stamp_ns=0, name="a lamp", lamps=(lamp,)))
        life.person.see(life.now_ns, TrackedObjects(stamp_ns=life.now_ns))
        assert choice(life, 2.0) == ("lamp l" if behaviour == "lamps" else "rest")


def stored(name: str, y_m: float, mode: Literal["button", "switch"] = "button") -> TrackedObject:
    position_m = (2.5, y_m, 1.4)
    return TrackedObject(
        id=name, kind="red", mode=mode, position_m=position_m, size_m=(0.3, 0.3, 0.3), length_m=0.3
    )


def hear(life: Life, object_id: str) -> None:
    name = Announced(stamp_ns=life.now_ns, object_id=object_id, label=object_id, began_ns=life.now_ns)
    life.person.see(life.now_ns, name)


def test_person_presses_only_at_the_right_name() -> None:
    life = living("pointing")
    life.before_step = lambda: life.objects(stored("a", 0.5), stored("b", -0.5))
    hear(life, "")
    assert choice(life, 2.0) in {"object a", "object b"}

    goal = life.person.goal.object_id
    hear(life, {"a": "b", "b": "a"}[goal])
    before = life.person._correction.now_rad
    life.run(1.5)
    assert life.presses == []
    assert life.person._correction.now_rad != before, "the name says where the ray is"

    hear(life, goal)
    life.run(0.6)
    assert life.presses == [], "a name takes time to be understood"

    life.run(1.4)
    assert len(life.presses) == 1


def test_switch_is_switched_off_again_later() -> None:
    life = living("pointing")
    life.before_step = lambda: life.objects(stored("radio", 0.0, "switch"))
    assert choice(life, 2.0) == "object radio"
    life.cue("selected", "red selected")
    assert choice(life, 5.0) == "rest"
    assert choice(life, 12.0) == "object radio"
    life.cue("deselected", "red deselected")
    assert choice(life, 5.0) == "rest"
    assert choice(life, 12.0) == "object radio"
