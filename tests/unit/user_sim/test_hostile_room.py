"""Hostile messages on the bus and clock steps do not end a simulated person."""

from typing import Literal

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas import (
    FARTHEST,
    Belt,
    Environment,
    Feedback,
    Lamp,
    LampColor,
    Message,
    Strip,
    StripFrame,
    StripsFrame,
    TrackedObject,
    TrackedObjects,
    UserProfile,
)
from pointit.schemas.topics import FEEDBACK, IMU, MAP, OBJECTS, STRIPS_FRAME
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.person import Person
from pointit.services.user_sim.service import UserSim
from pointit.services.user_sim.sight.sight import Sight
from tests.support.bench import ManualClock, memory_bench, until
from tests.unit.schemas.strategies import messages

HUGE = FARTHEST
S = 1_000_000_000
POINTING = Feedback(stamp_ns=0, cue="started")


def lamp_at(x_m: float) -> Environment:
    return Environment(stamp_ns=0, name="evil", lamps=(Lamp(id="l", position_m=(x_m, 0.0, 0.0)),))


def thing(
    surface: Literal["strip", "none"] = "none", value: float = HUGE, stamp_ns: int = 0
) -> TrackedObjects:
    item = TrackedObject(
        id="evil",
        kind="red",
        position_m=(value, -value, value),
        velocity_mps=(-value, value, value),
        surface=surface,
        surface_id="s",
        surface_position_m=value * FARTHEST,
        surface_speed_mps=-value,
    )
    return TrackedObjects(stamp_ns=stamp_ns, objects=(item,))


async def test_a_person_lives_on_in_a_room_of_nonsense_and_when_the_clock_is_set() -> None:
    clock = ManualClock()
    point = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    rooms = (
        Environment(stamp_ns=0, name="evil", strips=(Strip(id="s", line_m=point, pixels=1),)),
        Environment(
            stamp_ns=0, name="evil", strips=(Strip(id="s", line_m=((0, 0, 0), (HUGE, 0, 0)), pixels=1),)
        ),
        Environment(stamp_ns=0, name="evil", belts=(Belt(id="s", line_m=((HUGE, 0, 0), (-HUGE, 0, 0))),)),
        lamp_at(HUGE),
    )
    async with memory_bench(clock) as bench:
        samples = bench.collect(IMU, "anna")
        bench.start(UserSim, UserSimConfig(rate_hz=200.0, behaviour="select", target_kinds=("red",)), "anna")
        await bench.settle()
        bench.put(FEEDBACK, POINTING, "anna")
        for room in rooms:
            bench.put(MAP, room)
            frame = StripFrame(id="s", rgb=b"\xff\xff\xff")
            bench.put(STRIPS_FRAME, StripsFrame(stamp_ns=0, strips=(frame, frame)))
            for surface in ("strip", "none"):
                bench.put(OBJECTS, thing(surface, stamp_ns=clock.advance(0.5)), "foreign")
                for jump_s in (0.5, 0.5, -3600.0, 0.1, 7200.0):
                    clock.advance(jump_s)
                    before = len(samples)
                    await until(lambda before=before: len(samples) > before + 1, what="another sample")  # type: ignore[misc]
                    await bench.settle()  # fails if the person has


def test_objects_from_the_future_are_not_seen_and_trackers_do_not_pile_up() -> None:
    sight = Sight(0.0)
    sight.show(S, thing(value=1.0, stamp_ns=S))
    sight.look(S)
    assert len(sight.objects(S)) == 1
    sight.show(S, thing(value=1.0, stamp_ns=3600 * S))
    sight.look(S)
    assert not sight.objects(S)
    assert not sight._trackers


KINDS = (Environment, Feedback, LampColor, StripsFrame, TrackedObjects, UserProfile)


def met(message: Message) -> Message:
    """Return `message` with names that meet those of others."""
    match message:
        case TrackedObjects():
            named = [thing.model_copy(update={"kind": "red", "surface_id": "s"}) for thing in message.objects]
            return message.model_copy(update={"objects": tuple(named)})
        case Environment():
            strips = [strip.model_copy(update={"id": "s"}) for strip in message.strips]
            lamps = [lamp.model_copy(update={"id": "a"}) for lamp in message.lamps]
            return message.model_copy(update={"strips": tuple(strips), "lamps": tuple(lamps)})
        case StripsFrame():
            frames = [frame.model_copy(update={"id": "s"}) for frame in message.strips]
            return message.model_copy(update={"strips": tuple(frames)})
        case _:
            return message


anything: st.SearchStrategy[Message] = st.one_of([messages(kind) for kind in KINDS]).map(met)
cues: st.SearchStrategy[Literal["target", "started"]] = st.sampled_from(["target", "started"])
names = st.sampled_from(["a", "b"])


@given(
    st.lists(st.tuples(anything, names, st.floats(0.0, 5.0), st.booleans()), max_size=12),
    st.sampled_from(["select", "strips", "lamps", "random", "send"]),
    cues,
)
def test_no_message_ends_a_person(
    seen: list[tuple[Message, str, float, bool]], behaviour: str, cue: Literal["target", "started"]
) -> None:
    config = UserSimConfig.model_validate({"behaviour": behaviour, "target_kinds": ("red",)})
    person = Person(config, "a", np.random.default_rng(1))
    now_ns = 1_700_000_000 * S
    person.see(now_ns, Feedback(stamp_ns=0, cue=cue))
    for message, name, passed_s, is_now in seen:
        now_ns += round(passed_s * S)
        stamp_ns = now_ns if is_now else message.stamp_ns
        person.see(now_ns, message.model_copy(update={"stamp_ns": stamp_ns}), name)
        for _ in range(3):
            now_ns += S // 4
            person.step(now_ns)
