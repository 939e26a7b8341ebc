"""Claims on a site whose time passes faster than the wall's: links and clocks are not faster there."""

from pointit.schemas import Claim, SelectionEvent
from pointit.services.selector.arbiter import MAX_CLAIM_AGE_NS
from pointit.services.selector.service import Selector
from pointit.services.selector.shard_engine import GIVE_UP_NS, REPEAT_NS
from tests.support.bench import ManualClock, memory_bench, until
from tests.unit.selector.room import package
from tests.unit.selector.shards import ShardedSite

SPEED = 20.0
AGE_S = MAX_CLAIM_AGE_NS / 1e9


def a_site() -> ShardedSite:
    site = ShardedSite(("anna",), package("a", 3.0))
    site.arbiter.speed = site.shards["anna"].speed = SPEED
    return site


def dwell(site: ShardedSite) -> None:
    for _ in range(10):
        site.step(0.05, {"anna": 3.0})


def decisions(age_s: float) -> list[tuple[str, str]]:
    """Return the events of a claim of this age, s of the site's time."""
    site = a_site()
    site.step(AGE_S * SPEED * 2, {})
    claim = Claim(stamp_ns=site.now_ns - round(age_s * 1e9), object_id="a", wish="toggle")
    outputs = [one.message for one in site.arbiter.on_claim("anna", claim, site.now_ns)]
    return [(one.event, one.reason) for one in outputs if isinstance(one, SelectionEvent)]


def test_a_claim_is_as_old_as_the_wall_says() -> None:
    assert decisions(AGE_S * SPEED * 0.9) == [("selected", "")]
    [(event, reason)] = decisions(AGE_S * SPEED * 1.2)
    assert (event, "6 s ago" in reason) == ("refused", True)


def test_a_clock_is_as_far_ahead_as_the_wall_says() -> None:
    assert decisions(-0.9 * SPEED) == [("selected", "")]
    [(event, reason)] = decisions(-3.0 * SPEED)
    assert (event, "3 s ahead" in reason) == ("refused", True)


def test_claims_are_repeated_and_given_up_by_the_wall() -> None:
    site = a_site()
    dwell(site)
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


async def test_the_service_tells_its_speed() -> None:
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
