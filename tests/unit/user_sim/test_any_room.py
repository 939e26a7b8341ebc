"""Whatever valid messages others put on the bus, a simulated person lives on."""

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pointit.schemas import (
    Cursor,
    Environment,
    Interaction,
    LampColor,
    Localization,
    Message,
    Selection,
    TrackedObjects,
)
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.person import Person
from tests.unit.schemas.strategies import messages

S = 1_000_000_000
KINDS = (Cursor, Environment, Interaction, LampColor, Localization, Selection, TrackedObjects)


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
        case _:
            return message


anything: st.SearchStrategy[Message] = st.one_of([messages(kind) for kind in KINDS]).map(met)
states = st.sampled_from(["localizing", "pointing"])
names = st.sampled_from(["a", "b"])


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.lists(st.tuples(anything, names, st.floats(-5.0, 5.0), st.booleans()), max_size=12),
    st.sampled_from(["select", "strips"]),
    states,
)
def test_no_message_ends_a_person(
    seen: list[tuple[Message, str, float, bool]], behaviour: str, state: str
) -> None:
    config = UserSimConfig.model_validate({"behaviour": behaviour, "target_kinds": ("red",)})
    person = Person(config, "a", np.random.default_rng(1))
    now_ns = 1_700_000_000 * S
    person.see(now_ns, Interaction.model_validate({"stamp_ns": 0, "state": state}))
    for message, name, passed_s, is_now in seen:
        now_ns += round(passed_s * S)
        stamp_ns = now_ns if is_now else message.stamp_ns
        person.see(now_ns, message.model_copy(update={"stamp_ns": stamp_ns}), name)
        for _ in range(3):
            now_ns += S // 4
            person.step(now_ns)
