"""People who change from one selector to another while they point: nothing is changed that nobody meant."""

from pointit.services.selector.outputs import Owned
from pointit.services.selector.shard_engine import ShardEngine
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


def test_who_rests_on_what_they_selected_keeps_it_when_the_selector_begins_again() -> None:
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


def test_and_when_their_shard_ends() -> None:
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


def test_and_when_their_shard_begins_which_learns_only_later_what_is_selected() -> None:
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
