"""Hostile messages do not end a simulated person."""

from typing import Literal

import numpy as np
from hypothesis import example, given
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
    StripsFrame,
    TrackedObject,
    TrackedObjects,
    UserProfile,
)
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.person import SimulatedPerson
from pointit.services.user_sim.sight import Sight
from tests.unit.schemas.strategies import messages

S = 1_000_000_000


def thing(stamp_ns: int, value: float = 1.0, surface: Literal["strip", "none"] = "none") -> TrackedObjects:
    item = TrackedObject(
        id="evil", kind="red", position_m=(value, -value, value), velocity_mps=(-value, value, value),
        surface=surface, surface_id="s", surface_position_m=value * FARTHEST, surface_speed_mps=-value,
    )  # fmt: skip
    return TrackedObjects(stamp_ns=stamp_ns, objects=(item,))


def test_objects_from_the_future_are_ignored_and_trackers_are_bounded() -> None:
    sight = Sight(0.0)
    sight.show(S, thing(S))
    sight.look(S)
    assert len(sight.objects(S)) == 1
    sight.show(S, thing(3600 * S))
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
POINT = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
NONSENSE: list[Message] = [
    Environment(stamp_ns=0, name="evil", strips=(Strip(id="s", line_m=POINT, pixels=1),)),
    Environment(stamp_ns=0, name="evil", belts=(Belt(id="s", line_m=((FARTHEST, 0, 0), (-FARTHEST, 0, 0))),)),
    Environment(stamp_ns=0, name="evil", lamps=(Lamp(id="a", position_m=(FARTHEST, 0, 0)),)),
    thing(0, FARTHEST),
    thing(0, FARTHEST, "strip"),
]


@example([(said, "a", 0.5, True) for said in NONSENSE], "select", "started")
@given(
    st.lists(st.tuples(anything, names, st.floats(0.0, 5.0), st.booleans()), max_size=12),
    st.sampled_from(["select", "strips", "lamps", "send"]),
    cues,
)
def test_person_survives_any_message(
    seen: list[tuple[Message, str, float, bool]], behaviour: str, cue: Literal["target", "started"]
) -> None:
    config = UserSimConfig.model_validate({"behaviour": behaviour, "target_kinds": ("red",)})
    person = SimulatedPerson(config, "a", np.random.default_rng(1))
    now_ns = 1_700_000_000 * S
    person.see(now_ns, Feedback(stamp_ns=0, cue=cue))
    for message, name, passed_s, is_now in seen:
        now_ns += round(passed_s * S)
        stamp_ns = now_ns if is_now else message.stamp_ns
        person.see(now_ns, message.model_copy(update={"stamp_ns": stamp_ns}), name)
        for _ in range(3):
            now_ns += S // 4
            person.step(now_ns)
