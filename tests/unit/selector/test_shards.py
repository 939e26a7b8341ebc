"""Shards and the arbiter: one owner of each object, and each claim decided once, whatever the links do."""

from collections import Counter
from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointit.schemas import Claim, Feedback, Selection, SelectionEvent
from pointit.services.selector.claim_budget import MAX_CLAIMS, WARNING_NS
from pointit.services.selector.selection_engine import SelectionEngine
from pointit.services.selector.selection_publisher import Action
from tests.unit.selector.room import Room, at, package, packages
from tests.unit.selector.shards import OPEN_FILES, ShardedSite

USERS = ("anna", "ben", "carl")
PLACES = (3.0, 6.0, 9.0, None)
"""Two packages, an empty place, and no pointing."""


def a_site(users: tuple[str, ...] = USERS) -> ShardedSite:
    return ShardedSite(users, package("a", 3.0), package("b", 6.0))


def dwell(site: ShardedSite, *, deliver: bool = True, **places: float | None) -> None:
    for index in range(10):
        site.step(0.05, places)
        if deliver:
            for user in site.shards:
                site.deliver(user)
        if index % 5 == 4:
            site.tick()


def refusals(site: ShardedSite, user: str, claim: Claim) -> list[str]:
    outputs = site.arbiter.on_claim(user, claim, site.now_ns)
    events = [one.message for one in outputs if isinstance(one.message, SelectionEvent)]
    assert all(event.event == "refused" for event in events)
    return [event.reason for event in events]


def claimed(site: ShardedSite, object_id: str = "a", **fields: object) -> Claim:
    """Return a claim of now to toggle an object."""
    return Claim.model_validate({"stamp_ns": site.now_ns, "object_id": object_id, "wish": "toggle", **fields})


def stay(places: dict[str, float | None], count: int, site: ShardedSite) -> None:
    for _ in range(count):
        site.step(0.05, places)
    site.tick()


def set_cut(user: str, is_cut: bool, site: ShardedSite) -> None:
    site.links[user].is_cut = is_cut
    site.meet()


def deliver(user: str, count: int, twice: bool, site: ShardedSite) -> None:
    site.deliver(user, up=count, down=count, twice=twice)


def wait(duration_s: float, site: ShardedSite) -> None:
    site.step(duration_s, {})
    site.tick()


def restart(is_at_once: bool, site: ShardedSite) -> None:
    if site.is_running:
        site.end_arbiter()
    if is_at_once:
        site.start_arbiter()


_PEOPLE = st.fixed_dictionaries(dict.fromkeys(USERS, st.sampled_from(PLACES)))
_USER = st.sampled_from(USERS)
_STEPS: st.SearchStrategy[list[partial[None]]] = st.lists(
    st.one_of(
        st.builds(partial, st.just(stay), _PEOPLE, st.integers(2, 12)),
        st.builds(partial, st.just(set_cut), _USER, st.booleans()),
        st.builds(partial, st.just(deliver), _USER, st.integers(0, 4), st.booleans()),
        st.builds(partial, st.just(wait), st.floats(0.5, 7.0)),
        st.builds(partial, st.just(restart), st.booleans()),
    ),
    max_size=25,
)


@given(_STEPS)
@settings(max_examples=120, deadline=None)
@pytest.mark.slow
def test_each_object_has_one_owner_and_each_claim_one_event(
    steps: list[partial[None]],
) -> None:
    with OPEN_FILES:  # those of each example end with it
        _check_steps(steps)


def _check_steps(steps: list[partial[None]]) -> None:
    site = a_site()
    for step in steps:
        step(site)
    site.settle()
    _check_events(site.events)
    unanswered: Counter[str] = Counter()
    for user, claim in site.claims:
        answers = site.answers(user, claim)
        assert len(answers) <= 1
        unanswered[user] += not answers
    assert unanswered <= site.given_up, "a claim was lost without a word"
    for shard in site.shards.values():
        followed = {one: owned.user for one, owned in shard._ownership.ledger.entries.items()}
        assert followed == site.owners


def _check_events(events: list[SelectionEvent]) -> None:
    """Check that each object changes hands by its owner alone."""
    owners: dict[str, str] = {}
    for event in events:
        if event.event == "selected":
            assert event.object_id not in owners
            owners[event.object_id] = event.user
        elif event.event == "deselected":
            assert owners.pop(event.object_id) == event.user
        else:
            assert event.event == "refused"
            assert event.reason


def test_shards_select_as_one_selector_does() -> None:
    """With links that take no time."""
    site = a_site(("anna",))
    room = Room(*a_site().objects, **a_site().config.model_dump())
    for _ in range(10):
        dwell(site, anna=3.0)
        room.stay(0.5, 20.0, anna=3.0)
        dwell(site, anna=9.0)
        room.stay(0.5, 20.0, anna=9.0)
    assert [(event.event, event.stamp_ns) for event in site.events] == [
        (event.event, event.stamp_ns) for event in room.events
    ]
    assert len(room.events) == 10


def test_reservation_takes_few_claims_and_others_see_it() -> None:
    site = a_site(("anna", "ben"))
    site.step(0.01, {"ben": 3.0})
    for _ in range(12):
        site.step(0.02, {"anna": 3.0})
        site.deliver("anna")

    reserves = len(site.links["anna"].up)
    assert reserves <= 2
    assert site.claims == []

    site.deliver("ben")
    site.step(0.02, {"ben": 3.0})
    assert (site.hovers["ben"].action, site.hovers["ben"].taken_by) == ("refuse", "anna")

    site.step(2.0, {})
    site.tick()
    site.deliver("ben")
    site.step(0.02, {"ben": 3.0})
    assert site.hovers["ben"].taken_by == ""


def test_claim_of_a_departed_object_is_refused() -> None:
    site = a_site(("anna",))
    site.step(0.1, {})
    assert refusals(site, "anna", claimed(site, "z")) == ["object has left"]


@pytest.mark.parametrize(("action", "is_selected"), [("select", True), ("deselect", False)])
def test_claim_is_refused_when_its_effect_has_changed(action: Action, *, is_selected: bool) -> None:
    """She took the package over from ben, or the conveyor had refused it, while her claim was on its way."""
    site = a_site(("anna", "ben"))
    if is_selected:
        dwell(site, ben=3.0)
        site.take(site.arbiter.release("anna", "a", True, site.now_ns))
    else:
        site.step(0.1, {})
    status = "selected" if is_selected else "deselected"
    outputs = site.arbiter.on_claim("anna", claimed(site, action=action), site.now_ns)
    assert [cue.message.cue for cue in outputs if isinstance(cue.message, Feedback)] == ["refused"]
    [event] = [one.message for one in outputs if isinstance(one.message, SelectionEvent)]
    assert event.event == "refused"
    assert event.reason == f"red was {status} in the meantime: point again to change that"
    assert site.owners == ({"a": "anna"} if is_selected else {})


def test_claim_from_before_a_clear_does_not_select_again() -> None:
    site = a_site(("anna",))
    dwell(site, anna=3.0)
    dwell(site, anna=9.0)
    early = claimed(site, action="select")
    site.step(1.0, {})
    site.take(site.arbiter.clear("anna", site.now_ns))
    site.step(0.5, {})
    assert refusals(site, "anna", early) == ["red was deselected in the meantime: point again to change that"]
    assert site.owners == {}


def test_claim_past_the_last_way_is_refused_when_it_comes() -> None:
    decided = package("a", 3.0).model_copy(update={"bay": "1", "bay_until_ns": at(1.0)})
    site = ShardedSite(("anna",), decided)
    dwell(site, deliver=False, anna=3.0)
    site.step(1.0, {})
    site.deliver("anna")
    assert [event.event for event in site.events] == ["refused"]
    assert "past its last way" in site.events[0].reason


def test_claim_before_the_first_objects_is_decided_when_repeated() -> None:
    site = a_site(("anna",))
    dwell(site, deliver=False, anna=3.0)
    [(user, claim)] = site.claims
    begun = SelectionEngine(site.config, site.records.append)
    assert begun.on_claim(user, claim, site.now_ns) == []
    begun.on_objects("conveyor", packages(site.time_s, *site.objects))
    outputs = begun.on_claim(user, claim, site.now_ns)
    assert [one.message.event for one in outputs if isinstance(one.message, SelectionEvent)] == ["selected"]


def many(count: int) -> tuple[ShardedSite, list[Claim]]:
    """Return a site of many packages, and claims of anna's to each of them."""
    site = ShardedSite(("anna", "ben"), *(package(f"p{index}", 0.1 * index) for index in range(count)))
    site.step(0.1, {})
    return site, [claimed(site, f"p{index}", stamp_ns=site.now_ns + index) for index in range(count)]


def test_excessive_claims_are_ignored_and_shown_in_health() -> None:
    site, claims = many(50)
    events = [
        one.message
        for claim in claims
        for one in site.arbiter.on_claim("anna", claim, site.now_ns)
        if isinstance(one.message, SelectionEvent)
    ]
    assert len(events) == len(site.owners) == len(site.records) == MAX_CLAIMS
    assert "of anna are ignored" in site.arbiter.excess(site.now_ns)
    assert site.arbiter.on_claim("ben", claims[-1], site.now_ns), "others are decided"
    site.step(1.0, {})
    assert site.arbiter.on_claim("anna", claims[20], site.now_ns), "it is when it comes again"
    site.step(WARNING_NS / 1e9, {})
    assert site.arbiter.excess(site.now_ns) == ""


def test_shard_reserves_at_most_two_objects_with_few_selections() -> None:
    site, claims = many(50)
    selections: list[Selection] = []
    for index, claim in enumerate(claims):
        now_ns = site.now_ns + index * 10_000_000
        wish = claim.model_copy(update={"wish": "reserve", "stamp_ns": now_ns})
        outputs = site.arbiter.on_claim("anna", wish, now_ns)
        selections += [one.message for one in outputs if isinstance(one.message, Selection)]
    last = [one.id for one in site.arbiter.selection(site.now_ns).reserved]
    assert last == [f"p{index}" for index in (MAX_CLAIMS - 2, MAX_CLAIMS - 1)]
    assert 2 <= len(selections) <= 3


def test_decided_claims_are_remembered_for_each_person() -> None:
    site, _ = many(3)
    claim = claimed(site, "p0")
    assert site.arbiter.on_claim("ben", claim, site.now_ns)
    for index in range(10_000):
        if index % MAX_CLAIMS == 0:
            site.time_s += 1.0
        site.arbiter.on_claim("anna", claimed(site, "p1", stamp_ns=site.now_ns + index), site.now_ns)
    assert site.arbiter.on_claim("ben", claim, site.now_ns) == []
