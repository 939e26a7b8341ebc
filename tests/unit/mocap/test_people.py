"""People who wear marker bodies."""

from pointit.bridges.mocap.config import MocapConfig
from pointit.bridges.mocap.people import WornBodies
from pointit.schemas.system import Figure
from tests.support.bench import START_NS


def test_figures_of_a_person_with_the_longest_name_are_accepted_by_health() -> None:
    person = "p" * 64
    bodies = {"cuff": {"person": person, "part": "forearm"}, "cap": {"person": person}}
    config = MocapConfig.model_validate({"server": "127.0.0.1", "truth": True, "bodies": bodies})
    figures = WornBodies(config).figures(START_NS)
    assert len(figures) == 3
    assert [Figure(name=name, value=1.0, unit=unit).name for name, (_, unit) in figures.items()] == [*figures]
