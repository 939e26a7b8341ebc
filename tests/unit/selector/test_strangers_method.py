"""A selection method of another package: chosen by name, with its own times, and alone with its faults."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import ValidationError

from pointit.runtime.errors import RefusedError
from pointit.schemas import SetMethod
from pointit.schemas.topics import SET_METHOD
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.methods.pointer import apply_method
from tests.support import strangers
from tests.support.bench import until
from tests.unit.selector.room import Room, package
from tests.unit.selector.served import served

MODULE = """
from pointit.plugins import NS_PER_S, MethodConfig, SelectionProgress, SelectionMethod

class Patient:
    def __init__(self, config, surroundings):
        self.dwell_ns = config.dwell_s * NS_PER_S
        self.is_faulty = surroundings.user == "anna" and config.dwell_s > 2
        self.latched = set()
        self.hovered, self.since_ns = None, 0

    def step(self, pointing):
        if self.is_faulty:
            return SelectionProgress(pointing.under, float("nan"))
        now_ns = pointing.cursor.stamp_ns
        if pointing.under != self.hovered:
            self.latched.discard(self.hovered)
            self.hovered, self.since_ns = pointing.under, now_ns
        if self.hovered is None or self.hovered in self.latched or not pointing.acts(self.hovered):
            return SelectionProgress(self.hovered)
        share = (now_ns - self.since_ns) / self.dwell_ns
        if share < 1:
            return SelectionProgress(self.hovered, share)
        self.latch(self.hovered)
        return SelectionProgress(self.hovered, fired=self.hovered)

    def latch(self, object_id):
        self.latched.add(object_id)

PATIENT = SelectionMethod(summary="stay without a break", config=MethodConfig, make=Patient)
"""


@pytest.fixture(autouse=True)
def _installed(tmp_path: Path) -> Iterator[None]:
    entries = "patient = strangers_methods:PATIENT\nlost = strangers_methods:LOST"
    with strangers.installed(tmp_path, "strangers_methods", MODULE, selection_methods=entries):
        yield


def test_packaged_method_selects_after_its_own_or_the_set_time() -> None:
    room = Room(package("a", 5.0), package("b", 8.0), method="patient", patient={"dwell_s": 1.5})
    room.stay(1.4, anna=5.0)
    assert 0.8 < room.hovers["anna"][-1].progress < 1.0
    room.stay(0.2, anna=5.0)
    assert room.told == [("selected", "a", "anna")]
    assert room.records[-1].method == "patient"
    room.selecting.use(apply_method(room.config, room.config, None, 0.3))
    room.stay(0.4, anna=8.0)
    assert room.told[-1] == ("selected", "b", "anna")


def test_parameters_of_a_package_are_validated() -> None:
    for values, sentence in (
        ({"method": "absent"}, "use one of estimate, fraction, gauge, hold, lost, patient"),
        ({"patient": {"dwell_s": 11}}, "10"),
        ({"hold": {"window_s": 1}}, "Extra inputs"),
    ):
        with pytest.raises(ValidationError, match=sentence):
            SelectorConfig.model_validate(values)


def test_method_failing_for_one_person_is_reported_and_serves_others() -> None:
    room = Room(package("a", 5.0), package("b", 8.0), method="patient", patient={"dwell_s": 2.5})
    room.stay(5.0, anna=5.0, ben=8.0)
    assert room.told == [("selected", "b", "ben")]
    assert room.hovers["anna"][-1].object_id == "a"
    assert room.selecting.fault() == "ValueError: progress nan, expected 0 to 1, 3 times now"


async def test_service_offers_methods_of_packages_and_names_a_failing_one() -> None:
    async with served() as site:
        reply = await site.bus.call(SET_METHOD, SetMethod(name="patient", dwell_s=0.4))
        assert (reply.name, reply.method, reply.dwell_s) == ("patient", "hold", 0.4)
        assert reply.installed == ("estimate", "fraction", "gauge", "hold", "lost", "patient")
        await site.stay("anna", 1.0, "a", "b")
        assert site.owners == [("a", "anna")]
        with pytest.raises(RefusedError, match="'lost' of strangers-parts cannot be imported"):
            await site.bus.call(SET_METHOD, SetMethod(name="lost"))
        await site.bus.call(SET_METHOD, SetMethod(name="patient", dwell_s=3.0))
        await site.stay("anna", 9.0, "a", "b")
        await until(lambda: site.warns("selection method 'patient' of strangers-parts failed"))
