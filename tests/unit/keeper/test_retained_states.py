"""The newest of every state: lookup, expiry and restoration."""

from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pointit.schemas import (
    NS_PER_S,
    ConveyorState,
    Deployment,
    Environment,
    ExpectedService,
    Lamp,
    LampColor,
    Localization,
    Message,
    Selection,
    UserPose,
    UserProfile,
    topics,
)
from pointit.services.keeper.retained_states import (
    KeeperConfig,
    RetainedStates,
    StateRecord,
    StoredState,
    retained,
)

NOW_NS = 1_000 * NS_PER_S


def profile(seq: int = 1, stamp_ns: int = 1) -> UserProfile:
    return UserProfile(stamp_ns=stamp_ns, seq=seq)


def pose(method: Any = "fixed") -> UserPose:
    return UserPose(stamp_ns=1, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0, method=method)


def shelf(**parameters: Any) -> RetainedStates:
    made = RetainedStates(KeeperConfig(**parameters))
    made.set_user("anna", NOW_NS, present=True)
    made.set_instance("pui", NOW_NS, present=True)
    return made


def held(kept: RetainedStates, topic: topics.Topic[Any]) -> dict[str, Message]:
    return dict(kept.lookup(topic))


def test_every_state_is_retained_except_those_ending_with_their_writers() -> None:
    states = [topic for topic in topics.TOPICS if topic.delivery is topics.Delivery.STATE]
    assert [topic for topic in states if topic not in retained()] == [
        topics.THING_STATES,
        topics.LAMP_LEASES,
        topics.CLOCK,
        topics.CONFIGURATION,
    ]


def test_newest_state_is_the_last_received_whatever_its_stamp() -> None:
    kept = shelf()
    kept.take(topics.PROFILE, "anna", profile(7, stamp_ns=900), NOW_NS)
    kept.take(
        topics.PROFILE, "anna", profile(1, stamp_ns=5), NOW_NS
    )  # restarted, on a machine whose clock is behind
    assert held(kept, topics.PROFILE) == {"anna": profile(1, stamp_ns=5)}
    assert len(kept) == 1


PERSON_S = 30.0
SITE_S = 100.0
MAX_VALUES = 3

people = st.sampled_from(["anna", "ben", "carl"])
pauses_s = st.sampled_from([0.0, 1.0, 10.0, 29.0, 30.0, 31.0, 99.0, 100.0, -5.0, -500.0])
doings = st.lists(
    st.tuples(pauses_s, st.sampled_from(["profile", "selection", "user", "selector"]), people, st.booleans()),
    max_size=50,
)


@dataclass
class Reading:
    """Model of the configuration's promise: states, and the time at which their owner was last present, s."""

    owned_s: dict[tuple[str, str], float] = field(default_factory=dict)
    present: set[str] = field(default_factory=set)
    refused: int = 0

    def is_owned(self, kind: str, name: str) -> bool:
        return (name if kind == "profile" else "selector") in self.present

    def expire(self, now_s: float) -> None:
        for (kind, name), owned_s in [*self.owned_s.items()]:
            if self.is_owned(kind, name) or owned_s > now_s:  # the clock was set back
                self.owned_s[kind, name] = now_s
            elif now_s - owned_s >= (PERSON_S if kind == "profile" else SITE_S):
                del self.owned_s[kind, name]

    def store(self, kind: str, name: str, now_s: float) -> None:
        self.owned_s.pop((kind, name), None)
        strangers = [row for row in self.owned_s if row[0] == "profile" and not self.is_owned(*row)]
        if len(self.owned_s) >= MAX_VALUES and strangers:
            del self.owned_s[strangers[0]]
        if len(self.owned_s) >= MAX_VALUES:
            self.refused += 1
            return
        self.owned_s[kind, name] = now_s

    def handed_out(self, kind: str) -> set[str]:
        """Return the names of states, those of people only while they are present."""
        rows = [name for row_kind, name in self.owned_s if row_kind == kind]
        return {name for name in rows if kind != "profile" or name in self.present}


@settings(max_examples=200)
@given(doings)
@example([(0.0, "user", "anna", True), (0.0, "profile", "anna", True), (9.0, "user", "anna", False)])
def test_any_states_are_retained_as_long_as_promised(events: list[tuple[float, str, str, bool]]) -> None:
    kept = RetainedStates(
        KeeperConfig(forget_person_after_s=PERSON_S, forget_site_after_s=SITE_S, max_values=MAX_VALUES)
    )
    reading = Reading()
    now_s = 1e6
    for pause_s, kind, name, present in events:
        now_s += pause_s
        now_ns = round(now_s * NS_PER_S)
        reading.expire(now_s)
        kept.expire(now_ns)
        if kind == "profile":
            reading.store(kind, name, now_s)
            kept.take(topics.PROFILE, name, profile(), now_ns)
        elif kind == "selection":
            reading.store(kind, "", now_s)
            kept.take(topics.SELECTION, "", Selection(stamp_ns=1), now_ns)
        else:
            subject = name if kind == "user" else "selector"
            change = kept.set_user if kind == "user" else kept.set_instance
            change(subject, now_ns, present=present)
            reading.present -= {subject}
            reading.present |= {subject} if present else set()

        assert set(held(kept, topics.PROFILE)) == reading.handed_out("profile")
        assert set(held(kept, topics.SELECTION)) == reading.handed_out("selection")
        assert len(kept) == len(reading.owned_s)
        assert kept.size == sum(len(state.payload) for state in kept.record(now_ns).states)
        assert kept.refused == reading.refused


def deployment(name: str, *, scenario: str = "", is_over: bool = False) -> Deployment:
    user = "" if scenario else name
    services = () if is_over else tuple(ExpectedService(service=each, user=user) for each in ("pui", "goal"))
    return Deployment(stamp_ns=1, name=name, services=services, scenario=scenario)


def test_vanished_deployment_is_retained_for_a_day() -> None:
    kept = shelf(forget_deployment_after_s=86_400.0)
    services = (ExpectedService(service="pui"), ExpectedService(service="pointing", user="anna"))
    run = Deployment(stamp_ns=1, name="demo", services=services)
    kept.take(topics.DEPLOYMENT, "run.demo", run, NOW_NS)
    kept.take(topics.DEPLOYMENT, "empty", Deployment(stamp_ns=1, name="empty"), NOW_NS)
    assert set(held(kept, topics.DEPLOYMENT)) == {"run.demo"}
    kept.set_instance("pointing.anna", NOW_NS, present=True)
    kept.set_instance("pui", NOW_NS, present=False)
    gone_ns = NOW_NS + 3600 * NS_PER_S
    kept.set_instance("pointing.anna", gone_ns, present=False)
    kept.expire(gone_ns + 86_399 * NS_PER_S)
    assert held(kept, topics.DEPLOYMENT) == {"run.demo": run}
    kept.expire(gone_ns + 86_400 * NS_PER_S)
    assert held(kept, topics.DEPLOYMENT) == {}


def test_scenario_is_missing_until_another_starts_and_people_stay() -> None:
    kept = shelf()
    for name, scenario in (("run.scenario_4", "scenario_4"), ("anna", ""), ("run.scenario_2", "scenario_2")):
        kept.take(topics.DEPLOYMENT, name, deployment(name, scenario=scenario), NOW_NS)
    assert set(held(kept, topics.DEPLOYMENT)) == {"anna", "run.scenario_2"}


@pytest.mark.parametrize(
    ("topic", "fine", "misleading"),
    [
        (topics.POSE, pose(), pose("external")),
        (
            topics.LOCALIZATION,
            Localization(stamp_ns=1, phase="solved"),
            Localization(stamp_ns=1, phase="sampling"),
        ),
        (topics.DEPLOYMENT, deployment("anna"), deployment("anna", is_over=True)),
    ],
)
def test_misleading_state_drops_the_one_before(
    topic: topics.Topic[Any], fine: Message, misleading: Message
) -> None:
    kept = shelf()
    kept.take(topic, "anna", fine, NOW_NS)
    assert held(kept, topic) == {"anna": fine}
    kept.take(topic, "anna", misleading, NOW_NS)
    assert held(kept, topic) == {}


def test_ownerless_states_are_evicted_within_number_and_size() -> None:
    kept = shelf(max_values=3)
    kept.take(topics.PROFILE, "anna", profile(), NOW_NS)
    for number in range(100):
        kept.take(topics.PROFILE, f"made-up-{number}", profile(), NOW_NS)
    assert len(kept) == 3
    assert set(held(kept, topics.PROFILE)) == {"anna"}
    for lane in ("a", "b", "c"):
        kept.take(topics.CONVEYOR_STATE, lane, ConveyorState(stamp_ns=1, speed_mps=0.5), NOW_NS)
    assert len(kept) == 3
    assert kept.refused == 1, "there was room for two"
    assert set(held(kept, topics.PROFILE)) == {"anna"}
    kept.take(topics.PROFILE, "anna", profile(9), NOW_NS)
    assert held(kept, topics.PROFILE) == {"anna": profile(9)}, "what is known has its room"


def test_total_size_of_states_is_bounded() -> None:
    kept = shelf(max_mb=1.0)
    kept.set_user("ben", NOW_NS, present=True)
    name = "x" * 12_000
    for number in range(200):
        services = (ExpectedService(service="pui", command=(name,)),)
        kept.take(
            topics.DEPLOYMENT, f"run.d{number}", Deployment(stamp_ns=1, name="d", services=services), NOW_NS
        )
    assert kept.size <= 1e6
    assert len(kept) + kept.refused == 200
    assert kept.refused > 0


def test_restarted_keeper_restores_states_without_a_newer_one() -> None:
    before = shelf()
    before.take(topics.PROFILE, "anna", profile(3), NOW_NS)
    before.take(topics.SELECTION, "", Selection(stamp_ns=1, seq=7), NOW_NS)
    after = shelf()
    after.take(topics.SELECTION, "", Selection(stamp_ns=0, seq=1), NOW_NS)
    assert after.restore(before.record(NOW_NS), NOW_NS) == 0
    assert held(after, topics.PROFILE) == {"anna": profile(3)}
    assert held(after, topics.SELECTION) == {"": Selection(stamp_ns=0, seq=1)}
    assert (
        after.record(NOW_NS).states[::-1]
        == before.record(NOW_NS).states[:1] + after.record(NOW_NS).states[:1]
    )


def test_unusable_records_are_counted_and_skipped() -> None:
    good = shelf()
    good.take(topics.PROFILE, "anna", profile(3), NOW_NS)
    payload = good.record(NOW_NS).states[0].payload
    states = (
        StoredState(key=topics.PROFILE.key, name="anna", schema_name="UserProfile.v1", payload=b"\xc1"),
        StoredState(key=topics.PROFILE.key, name="a/b", schema_name="UserProfile.v1", payload=payload),
        StoredState(key="of/another/version", name="", schema_name="X.v1", payload=payload),
        StoredState(key=topics.CLOCK.key, name="", schema_name="ClockTick.v1", payload=payload),
        StoredState(key=topics.SELECTION.key, name="", schema_name="Selection.v1", payload=payload),
    )
    kept = shelf()
    assert kept.restore(StateRecord(stamp_ns=1, states=states), NOW_NS) == 5
    assert len(kept) == 0


def test_person_neither_ends_the_run_nor_has_others_missed() -> None:
    kept = shelf()
    kept.take(topics.DEPLOYMENT, "run.scenario_4", deployment("scenario_4", scenario="scenario_4"), NOW_NS)
    kept.take(topics.DEPLOYMENT, "anna", deployment("scenario_2", scenario="scenario_2"), NOW_NS)
    assert set(held(kept, topics.DEPLOYMENT)) == {"run.scenario_4"}


def test_lamps_outside_the_map_are_evicted_first() -> None:
    kept = shelf(max_values=3)
    lamp = LampColor(stamp_ns=1, color=(1, 2, 3))
    room = Environment(stamp_ns=1, name="lab", lamps=(Lamp(id="real", position_m=(0.0, 0.0, 1.0)),))
    kept.take(topics.MAP, "", room, NOW_NS)
    kept.take(topics.LAMP_COLOR, "real", lamp, NOW_NS)
    for number in range(10):
        kept.take(topics.LAMP_COLOR, f"x{number}", lamp, NOW_NS)
    kept.take(topics.SELECTION, "", Selection(stamp_ns=1), NOW_NS)
    assert (set(held(kept, topics.LAMP_COLOR)), set(held(kept, topics.SELECTION))) == ({"real"}, {""})
    assert kept.refused == 0
