"""Writers of a topic, and messages to the person if nothing comes."""

import pytest

from pointit.diagnosis.writers import present_writers, silence_reason
from pointit.schemas.system import instance_of, split_instance
from pointit.schemas.topics import CLOCK, CURSOR, HEALTH, IMU, MAP, POSE, RAY, SELECTION

PRESENT = {"pointing.anna", "pointing.ben", "pui", "user-sim.anna", "imu-bridge.ben"}


@pytest.mark.parametrize("parts", [("pui", ""), ("pointing", "anna"), ("user-sim", "a.b-c")])
def test_instances_are_taken_apart_as_they_are_put_together(parts: tuple[str, str]) -> None:
    assert split_instance(instance_of(*parts)) == parts


def test_a_persons_topic_is_written_by_their_own_services() -> None:
    assert present_writers(RAY, "anna", PRESENT) == ["pointing.anna"]
    assert present_writers(RAY, "*", PRESENT) == ["pointing.anna", "pointing.ben"]
    assert present_writers(IMU, "*", PRESENT) == ["imu-bridge.ben", "user-sim.anna"]
    assert present_writers(RAY, "eve", PRESENT) == []


def test_a_site_service_writes_for_everybody() -> None:
    assert present_writers(CURSOR, "anna", PRESENT) == ["pui"]
    assert present_writers(MAP, "", PRESENT) == ["pui"]


def test_a_shard_writes_of_people_but_not_what_is_of_the_site() -> None:
    present = {"pui.hall", "selector.anna"}
    assert present_writers(CURSOR, "anna", present) == ["pui.hall"]
    assert present_writers(MAP, "", present) == []
    assert present_writers(SELECTION, "", present) == []


def test_everybody_writes_their_own_health() -> None:
    assert present_writers(HEALTH, "pui", PRESENT) == ["pui"]
    assert present_writers(HEALTH, "selector", PRESENT) == []
    assert set(present_writers(HEALTH, "*", PRESENT)) == PRESENT


def test_silence_is_explained() -> None:
    assert "pointing.anna can write it and runs" in silence_reason(RAY, "anna", PRESENT)
    assert "`pointit service run pointing --user eve`" in silence_reason(RAY, "eve", PRESENT)
    assert "`pointit service run pointing --user NAME`" in silence_reason(RAY, "*", ())
    assert "`pointit service run pui`" in silence_reason(MAP, "", ())
    assert "(localizer or ros2 or external)" in silence_reason(POSE, "anna", ())
    assert silence_reason(CLOCK, "", ()) == "it is written by cli or ros2"
