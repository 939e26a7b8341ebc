"""Whatever valid messages others put on the bus, a simulated person lives on."""

from typing import Literal

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas import (
    Environment,
    Feedback,
    LampColor,
    Message,
    StripsFrame,
    TrackedObjects,
    UserProfile,
)
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.person import Person
from tests.unit.schemas.strategies import messages

S = 1_000_000_000
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
