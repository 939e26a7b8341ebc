"""Shards: people who change selectors while they point, and claims where the site's time is fast."""

import pytest

from pointit.schemas import Claim, SelectionEvent
from pointit.services.selector.arbiter import MAX_CLAIM_AGE_NS
from pointit.services.selector.selection_engine import GIVE_UP_NS, REPEAT_NS, ShardEngine
from pointit.services.selector.selection_publisher import Owned
from pointit.services.selector.service import Selector
from tests.support.bench import ManualClock, memory_bench, until
from tests.unit.selector.room import MAP, Room, package
from tests.unit.selector.shards import ShardedSite


def rest(site: ShardedSite, duration_s: float, x_m: float = 3.0, *, by_site: bool = False) -> None:
    """Have anna point somewhere, served by her shard or by the site's selector."""
    for _ in range(round(duration_s / 0.05)):
        site.step(0.05, {} if by_site else {"anna": x_m})
        if by_site:
            site.point("anna", x_m)
        site.deliver("anna")


def a_site() -> ShardedSite:
    return ShardedSite(("anna",), package("a", 3.0))


def told(site: ShardedSite) -> list[str]:
    return [event.event for event in site.events]


def test_object_pointed_at_stays_selected_when_the_selector_restarts() -> None:
    room = Room(package("a", 3.0))
    room.stay(1.0, anna=3.0)
    assert room.owners == {"a": "anna"}
    again = Room(package("a", 3.0))
    again.time_s = room.time_s
    again.selecting.restore({"a": Owned("anna", "red", room.events[0].stamp_ns)}, 1, room.now_ns)
    again.stay(2.0, anna=3.0)
    assert again.events == []
    again.stay(1.0, anna=9.0)
    again.stay(2.0, anna=3.0)
    assert again.told == [("deselected", "a", "anna")]


def test_object_pointed_at_stays_selected_when_the_shard_ends() -> None:
    site = a_site()
    rest(site, 0.2, by_site=True)
    rest(site, 0.5, 9.0, by_site=True)
    site.arbiter.on_shard("anna")
    rest(site, 0.5)
    assert told(site) == ["selected"]
    rest(site, 1.0, by_site=True)
    assert told(site) == ["selected"]
    rest(site, 0.5, 9.0, by_site=True)
    rest(site, 0.5, by_site=True)
    assert told(site) == ["selected", "deselected"]


def test_object_pointed_at_stays_selected_when_a_shard_starts() -> None:
    site = a_site()
    rest(site, 0.5, by_site=True)
    assert told(site) == ["selected"]

    site.shards["anna"] = ShardEngine(site.config)
    site.shards["anna"].on_map(MAP)
    site.meet()
    site.links["anna"].down.clear()
    for _ in range(3):
        site.step(0.05, {"anna": 3.0})
    site.shards["anna"].on_selection(site.arbiter.selection(site.now_ns))

    rest(site, 1.0)
    assert told(site) == ["selected"]
    rest(site, 0.5, 9.0)
    rest(site, 0.5)
    assert told(site) == ["selected", "deselected"]


@pytest.mark.parametrize(
    ("late", "second", "lost", "is_slow"),
    [
        ("first", "site", None, False), ("second", "site", 3, True),
        ("first", "shard", 3, False), ("second", "shard", None, True),
    ],
)  # fmt: skip
def test_person_of_two_selectors_selects_once(
    late: str, second: str, lost: int | None, *, is_slow: bool
) -> None:
    """One of them gets the first cursor later, or loses one, and so is done a moment later."""
    site = ShardedSite(("anna", "anna.2"), package("a", 3.0))
    for index in range(40):
        gets = {name: index not in (lost, 0) or name != late for name in ("first", "second")}
        places: dict[str, float | None] = {"anna": 3.0} if gets["first"] else {}
        if second == "shard" and gets["second"]:
            places["anna.2"] = 3.0
        site.step(0.05, places)
        if second == "site" and gets["second"]:
            site.point("anna", 3.0)
        for name in (*site.shards, *site.shards):
            site.deliver(name, down=0 if is_slow and index < 10 else 1000)
    assert [one for one in told(site) if one != "refused"] == ["selected"]
    assert site.owners == {"a": "anna"}
    assert len(told(site)) == 1 or is_slow, "nothing to refuse to who knows of the selection"


def test_claim_just_after_another_selectors_change_is_refused() -> None:
    site = ShardedSite(("anna", "anna.2"), package("a", 3.0))
    site.arbiter.on_shard("anna")
    rest(site, 0.5)
    [(user, claim)] = site.claims
    again = Claim(stamp_ns=claim.stamp_ns + 50_000_000, object_id="a", wish="toggle", action="deselect")
    site.take(site.arbiter.on_claim(user, again, site.now_ns))
    assert told(site) == ["selected", "refused"]
    assert site.events[-1].reason == "red was changed by you just now: leave it, then point again"
    much_later = again.model_copy(update={"stamp_ns": claim.stamp_ns + 150_000_000})
    site.take(site.arbiter.on_claim(user, much_later, site.now_ns))
    assert told(site)[-1] == "deselected"


def test_person_can_deselect_when_a_slow_decision_has_come() -> None:
    """The event of their own claim latches nothing."""
    site = a_site()
    site.shards["anna"].on_selection(site.arbiter.selection(site.now_ns))
    for x_m, count in ((3.0, 8), (9.0, 8), (3.0, 4)):
        for _ in range(count):
            site.step(0.05, {"anna": x_m})
            site.deliver("anna", down=0)
    rest(site, 0.3)
    assert told(site) == ["selected", "deselected"]


SPEED = 20.0
AGE_S = MAX_CLAIM_AGE_NS / 1e9


def fast_site() -> ShardedSite:
    site = ShardedSite(("anna",), package("a", 3.0))
    site.arbiter.speed = site.shards["anna"].speed = SPEED
    return site


def dwell_on_it(site: ShardedSite) -> None:
    for _ in range(10):
        site.step(0.05, {"anna": 3.0})


def decisions(age_s: float) -> list[tuple[str, str]]:
    """Return the events of a claim of this age, s of the site's time."""
    site = fast_site()
    site.step(AGE_S * SPEED * 2, {})
    claim = Claim(stamp_ns=site.now_ns - round(age_s * 1e9), object_id="a", wish="toggle")
    outputs = [one.message for one in site.arbiter.on_claim("anna", claim, site.now_ns)]
    return [(one.event, one.reason) for one in outputs if isinstance(one, SelectionEvent)]


def test_claim_age_is_by_the_wall_clock() -> None:
    assert decisions(AGE_S * SPEED * 0.9) == [("selected", "")]
    [(event, reason)] = decisions(AGE_S * SPEED * 1.2)
    assert (event, "6 s ago" in reason) == ("refused", True)


def test_clock_error_is_by_the_wall_clock() -> None:
    assert decisions(-0.9 * SPEED) == [("selected", "")]
    [(event, reason)] = decisions(-3.0 * SPEED)
    assert (event, "3 s ahead" in reason) == ("refused", True)


def test_claims_are_repeated_and_given_up_by_the_wall_clock() -> None:
    site = fast_site()
    dwell_on_it(site)
    site.links["anna"].up.clear()
    site.step(REPEAT_NS / 1e9 * SPEED * 0.9, {})
    site.tick()
    assert not site.links["anna"].up
    site.step(GIVE_UP_NS / 1e9 * SPEED * 0.8, {})
    site.tick()
    assert len(site.links["anna"].up) == 1
    assert site.cues["anna"] == 0
    site.step(GIVE_UP_NS / 1e9 * SPEED * 0.3, {})
    site.tick()
    assert site.cues["anna"] == 1


async def test_service_passes_the_clocks_speed_to_its_engine() -> None:
    clock = ManualClock()
    clock.speed = SPEED
    started: list[Selector] = []

    class Watched(Selector):
        async def run(self) -> None:
            started.append(self)
            await super().run()

    async with memory_bench(clock) as bench:
        bench.start(Watched)
        await until(lambda: bool(started), what="the selector")
        await until(lambda: started[0]._engine.speed == SPEED, what="its speed")
