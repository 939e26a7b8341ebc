"""Time for which a page counts as having viewers."""

from pointit.launch.run.run_site import Onlookers
from pointit.runtime.link.outage import SILENT_S
from pointit.schemas import Figure, Health


def health(viewers: float | None, service: str = "web") -> Health:
    figures = () if viewers is None else (Figure(name="viewers", value=viewers),)
    return Health(stamp_ns=1, service=service, instance=f"{service}.2", pid=1, figures=figures)


def test_who_has_a_page_open_looks_on_until_it_was_not_heard_for_a_while() -> None:
    onlookers = Onlookers()
    assert not onlookers.are_there(0.0)
    assert onlookers.on_health(health(2.0), 10.0)
    assert onlookers.are_there(10.0 + SILENT_S - 0.1)
    assert not onlookers.on_health(health(0.0), 11.0)  # closed, or only reloaded
    assert onlookers.are_there(10.0 + SILENT_S - 0.1)
    assert not onlookers.are_there(10.0 + SILENT_S)


def test_nobody_looks_on_where_nobody_says_so() -> None:
    onlookers = Onlookers()
    for said in (health(0.0), health(None), health(3.0, "selector")):
        assert not onlookers.on_health(said, 10.0)
        assert not onlookers.are_there(10.0)
