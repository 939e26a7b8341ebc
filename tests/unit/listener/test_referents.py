"""Referents of a word: timing, order, distance, own place, sweeps, and doubt."""

import math
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas import Referents
from pointit.services.listener.referents import Spoken, decide, referents
from tests.unit.listener.gestures import at_ns, gesture, thing

LEFT = thing("left", 30.0)
MIDDLE = thing("middle", 0.0)
RIGHT = thing("right", -30.0)
THREE = (LEFT, MIDDLE, RIGHT)


def names(found: Referents) -> list[str]:
    return [one.name for one in found.candidates if one.kind == "thing"]


def test_thing_of_the_stay_about_the_word_is_meant() -> None:
    rays = gesture([(0.0, 0.0, 1.0), (30.0, 1.5, 2.3), (-30.0, 2.8, 3.5)])
    for said_s, meant in ((1.6, "left"), (2.9, "right")):
        found = referents(rays, THREE, Spoken(at_ns=at_ns(said_s)))
        assert names(found)[0] == meant
        assert found.candidates[0].probability > 0.9
        assert math.fsum(one.probability for one in found.candidates) + found.none == pytest.approx(1.0)


def test_two_words_take_two_stays_in_their_order() -> None:
    rays = gesture([(0.0, 0.0, 1.0), (30.0, 1.5, 2.0), (-30.0, 2.5, 3.5)])
    # both words are nearest to the first stay
    that_ns = at_ns(1.9)
    there_ns = at_ns(2.2)
    first = referents(rays, THREE, Spoken(at_ns=that_ns, others_ns=(there_ns,)))
    second = referents(rays, THREE, Spoken(at_ns=there_ns, others_ns=(that_ns,)))
    assert (names(first)[0], names(second)[0]) == ("left", "right")
    alone = referents(rays, THREE, Spoken(at_ns=at_ns(1.5)))
    assert names(alone)[0] == "left"


def test_this_is_nearer_than_that_when_both_are_possible() -> None:
    near = thing("near", 0.0, 1.2)
    far = thing("far", 0.0, 4.0)
    rays = gesture([(0.0, 0.0, 2.0)])
    this, that = (referents(rays, (near, far), Spoken(at_ns=at_ns(1.0), word=w)) for w in ("this", "that"))
    assert (names(this)[0], names(that)[0]) == ("near", "far")
    assert decide(this).do == "ask", "a preference is no certainty"
    assert decide(this, names=()).do == "refuse", "where nothing has that verb, nothing is meant"


def test_here_means_the_speakers_place_and_there_the_floor() -> None:
    rays = gesture([(90.0, 0.0, 2.0)])
    here = referents(
        rays, THREE, Spoken(at_ns=at_ns(1.0), word="here", own_m=(1.0, 2.0, 0.0), user="anna")
    ).candidates[0]
    assert (here.kind, here.name, here.place_m) == ("place", "anna", (1.0, 2.0, 0.0))
    there = referents(rays, THREE, Spoken(at_ns=at_ns(1.0), word="there")).candidates[0]
    assert (there.kind, there.name) == ("place", "floor")
    assert there.place_m == pytest.approx(rays[50].point_m)
    air = [ray.model_copy(update={"point_m": None}) for ray in rays]
    found = referents(air, THREE, Spoken(at_ns=at_ns(1.0), word="there")).candidates[0]
    assert (found.kind, found.place_m) == ("direction", None)


def test_these_are_all_that_the_arm_sweeps_over() -> None:
    rays = gesture([(45.0, 0.0, 0.2), (-15.0, 1.4, 1.6)])
    found = referents(rays, THREE, Spoken(at_ns=at_ns(0.8), word="these"))
    assert set(names(found)) == {"left", "middle"}
    assert found.none < 0.2
    assert referents(rays, (), Spoken(at_ns=at_ns(0.8), word="these")).candidates == ()


def test_direction_beside_targets_means_none_and_between_two_asks() -> None:
    beside = referents(gesture([(80.0, 0.0, 2.0)]), THREE, Spoken(at_ns=at_ns(1.0), word="that"))
    assert sum(one.probability for one in beside.candidates if one.kind == "thing") < 0.2
    assert decide(beside, ("thing",)).do == "refuse"
    pair = (thing("a", 5.0), thing("b", -5.0))
    between = decide(referents(gesture([(0.0, 0.0, 2.0)]), pair, Spoken(at_ns=at_ns(1.0))), ("thing",))
    assert between.do == "ask"
    assert {one.name for one in between.candidates} == {"a", "b"}


def test_drift_that_the_pose_states_makes_it_less_sure() -> None:
    rays = gesture([(22.0, 0.0, 2.0)])
    said = at_ns(1.0)
    sure, drifted = (
        referents(rays, THREE, Spoken(at_ns=said, yaw_sigma_rad=math.radians(sigma))) for sigma in (0.0, 15.0)
    )
    assert sure.candidates[0].name == drifted.candidates[0].name == "left"
    assert drifted.candidates[0].probability < sure.candidates[0].probability


def test_referent_among_200_things_takes_less_than_20_ms() -> None:
    many = [thing(f"t{index}", float(index % 60 - 30), low_deg=index // 60 * 5.0) for index in range(200)]
    rays = gesture([(0.0, 0.0, 2.0)])
    took_s: list[float] = []
    for _ in range(30):
        begun_s = time.thread_time()
        referents(rays, many, Spoken(at_ns=at_ns(1.0)))
        took_s.append(time.thread_time() - begun_s)
    assert max(took_s[1:]) < 0.02


@given(
    st.lists(st.tuples(st.floats(-180, 180), st.floats(0.05, 1.5)), min_size=1, max_size=6),
    st.floats(-2, 12),
    st.lists(st.floats(-2, 12), max_size=4),
    st.sampled_from(["", "this", "that", "here", "there", "these"]),
)
def test_probabilities_are_valid_for_any_word_and_rays(
    stays: list[tuple[float, float]], said_s: float, others_s: list[float], word: str
) -> None:
    begin_s = 0.0
    timed = list[tuple[float, float, float]]()
    for azimuth, long_s in stays:
        timed.append((azimuth, begin_s, begin_s + long_s))
        begin_s += long_s + 0.4
    others_ns = tuple(max(at_ns(each), 0) for each in others_s)
    said = Spoken(at_ns=at_ns(said_s), word=word, others_ns=others_ns, own_m=(0.0, 0.0, 0.0), user="anna")  # pyrefly: ignore[bad-argument-type]
    found = referents(gesture(timed, 20.0), THREE, said)
    assert 0.0 <= found.none <= 1.0
    probabilities = [one.probability for one in found.candidates]
    assert probabilities == sorted(probabilities, reverse=True)
    assert word == "these" or math.fsum(probabilities) + found.none == pytest.approx(1.0)
