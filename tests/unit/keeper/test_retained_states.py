"""The newest of every state: lookup, expiry and restoration."""

from typing import Any

import pytest

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


def test_every_state_is_retained_but_those_that_end_with_their_writers() -> None:
    states = [topic for topic in topics.TOPICS if topic.delivery is topics.Delivery.STATE]
    assert [topic for topic in states if topic not in retained()] == [
        topics.THING_STATES,
        topics.LAMP_LEASES,
        topics.CLOCK,
        topics.CONFIGURATION,
    ]


def test_the_newest_is_what_came_last_whatever_its_stamp() -> None:
    kept = shelf()
    kept.take(topics.PROFILE, "anna", profile(7, stamp_ns=900), NOW_NS)
    kept.take(
        topics.PROFILE, "anna", profile(1, stamp_ns=5), NOW_NS
    )  # restarted, on a machine whose clock is behind
    assert held(kept, topics.PROFILE) == {"anna": profile(1, stamp_ns=5)}
    assert len(kept) == 1


def test_states_of_an_absent_person_are_not_handed_out() -> None:
    kept = shelf(forget_person_after_s=30.0)
    kept.take(topics.PROFILE, "anna", profile(), NOW_NS)
    kept.take(topics.PROFILE, "ben", profile(), NOW_NS)
    assert set(held(kept, topics.PROFILE)) == {"anna"}, "ben is not there"
    kept.set_user("anna", NOW_NS + 100 * NS_PER_S, present=False)
    assert held(kept, topics.PROFILE) == {}
    kept.expire(NOW_NS + 129 * NS_PER_S)
    kept.set_user("anna", NOW_NS + 129 * NS_PER_S, present=True)
    assert set(held(kept, topics.PROFILE)) == {"anna"}, "back within the time"
    kept.set_user("anna", NOW_NS + 130 * NS_PER_S, present=False)
    kept.expire(NOW_NS + 160 * NS_PER_S)
    kept.set_user("anna", NOW_NS + 161 * NS_PER_S, present=True)
    assert held(kept, topics.PROFILE) == {}
    assert (len(kept), kept.size) == (0, 0)


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


def test_a_scenario_is_missed_until_another_begins_and_people_beside_it_stay() -> None:
    kept = shelf()
    for name, scenario in (("run.scenario_4", "scenario_4"), ("anna", ""), ("run.scenario_2", "scenario_2")):
        kept.take(topics.DEPLOYMENT, name, deployment(name, scenario=scenario), NOW_NS)
    assert set(held(kept, topics.DEPLOYMENT)) == {"anna", "run.scenario_2"}


def test_shared_state_outlives_its_writer_for_a_long_time() -> None:
    kept = shelf(forget_site_after_s=3600.0)
    kept.set_instance("selector", NOW_NS, present=True)
    kept.take(topics.SELECTION, "", Selection(stamp_ns=1, seq=7), NOW_NS)
    kept.set_instance("selector", NOW_NS + 7200 * NS_PER_S, present=False)
    kept.expire(NOW_NS + 10_799 * NS_PER_S)
    assert set(held(kept, topics.SELECTION)) == {""}
    kept.expire(NOW_NS + 10_800 * NS_PER_S)
    assert held(kept, topics.SELECTION) == {}


def test_a_clock_that_was_set_back_forgets_no_earlier_and_no_later() -> None:
    kept = shelf(forget_person_after_s=30.0)
    kept.take(topics.PROFILE, "ben", profile(), NOW_NS)
    kept.expire(NOW_NS - 500 * NS_PER_S)
    assert len(kept) == 1
    kept.expire(NOW_NS - 470 * NS_PER_S)
    assert len(kept) == 0


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


def test_strangers_give_way_and_neither_number_nor_size_grows_without_bound() -> None:
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


def test_a_restarted_keeper_takes_up_what_nothing_newer_has_replaced() -> None:
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


def test_lamps_that_are_not_in_the_map_give_way_to_everything_else() -> None:
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
