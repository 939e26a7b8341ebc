"""A simulated person who sees by a robot, or a part of one, where they point; and who speaks."""

from collections.abc import Callable

import numpy as np
import pytest

from pointit.geometry.vector import Vec3
from pointit.plugins import UserSim
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import NS_PER_S, BodyMeasures, Message, RobotState, TrackedObject, TrackedObjects, topics
from pointit.services.registry import process
from pointit.services.user_sim.config import AimConfig, UserSimConfig
from pointit.services.user_sim.correction import Correction
from pointit.services.user_sim.goal import PersonGoal
from pointit.services.user_sim.perception import Perception
from pointit.services.user_sim.sight import Sight
from pointit.sim.aim import Stance
from tests.support.bench import memory_bench

GOAL_M = (1.5, 0.2, 0.75)
HAND_M = (1.4, 0.1, 0.95)
NOW_NS = 100 * NS_PER_S


class SeenPlaces(Correction):
    """Remembers where the person saw their cursor."""

    def __init__(self) -> None:
        super().__init__(AimConfig(), Stance(BodyMeasures()), np.random.default_rng(1))
        self.places_m: list[Vec3] = []

    def see(self, point_m: Vec3, at_ns: int, goal: PersonGoal, *, confirms: bool = True) -> None:
        del at_ns, goal, confirms
        self.places_m.append(point_m)


def hand(velocity_mps: Vec3 = (0.0, 0.0, 0.0)) -> TrackedObjects:
    part = TrackedObject(id="hand", kind="arm", position_m=HAND_M, velocity_mps=velocity_mps)
    return TrackedObjects(stamp_ns=NOW_NS, objects=(part,))


def robot() -> RobotState:
    return RobotState(
        stamp_ns=NOW_NS,
        kind="quadrotor",
        phase="moving",
        position_m=HAND_M,
        yaw_rad=0.0,
        velocity_mps=(0.0, 0.0, 0.0),
        radius_m=0.1,
    )


def seen_places_m(message: Message, goal_name: str) -> list[Vec3]:
    """Return where a person who points sees their cursor by the object or robot `goal_name`."""
    sight = Sight(0.0)
    correction = SeenPlaces()
    perception = Perception(sight, correction)
    perception.perceived.state = "pointing"
    sight.show(NOW_NS, message, "hand")
    sight.look(NOW_NS)
    perception.update(NOW_NS, PersonGoal("box", GOAL_M, closed_loop=True, robot=goal_name))
    return correction.places_m


@pytest.mark.parametrize(
    ("follower", "place_m"),
    [(hand, (HAND_M[0], HAND_M[1], GOAL_M[2])), (robot, HAND_M)],
)
def test_follower_shows_where_the_person_points(follower: Callable[[], Message], place_m: Vec3) -> None:
    assert seen_places_m(follower(), "hand") == [place_m]


def test_part_that_moves_or_is_of_another_name_shows_nothing() -> None:
    assert seen_places_m(hand((0.5, 0.0, 0.0)), "hand") == []
    assert seen_places_m(hand(), "foot") == []


def test_topics_of_a_simulated_person_are_those_of_the_process_table() -> None:
    row = process("user-sim")
    assert {*UserSim.READS} == {*row.reads}
    assert {*UserSim.WRITES} == {*row.writes}


async def test_person_speaks_as_a_recogniser_understands() -> None:
    async with memory_bench(VirtualClock()) as bench:
        speeches = bench.collect(topics.SPEECH)
        people: list[UserSim] = []

        class Speaking(UserSim):
            async def run(self) -> None:
                people.append(self)
                await super().run()

        bench.start(Speaking, UserSimConfig(), user="anna")
        await bench.settle()
        assert speeches == []
        people[0].say("put it back")
        await bench.settle()
        (speech,) = speeches
        assert [word.text for word in speech.words] == ["put", "it", "back"]
        assert speech.is_final
