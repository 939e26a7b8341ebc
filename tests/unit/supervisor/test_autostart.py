"""A person whose device has no button: samples begin, unless a press ended it."""

import pytest

from pointit.services.supervisor import user_messages
from pointit.services.supervisor.life_cycle import LifeCycle
from tests.unit.supervisor.played import Gesture, S, life_cycle, news, pose, press, sample, shown, told


def eager(*, localize: bool = False) -> LifeCycle:
    cycle = life_cycle(localize=localize, autostart=True, retry_s=5.0)
    cycle.begin(0)
    return cycle


def test_without_a_button_a_sample_begins_as_soon_as_the_place_is_known() -> None:
    cycle = eager()
    assert cycle.imu(*sample(1)) == []  # neither a place nor a complaint
    assert shown(cycle.pose(*pose(2))).next_step == user_messages.BY_ITSELF
    assert cycle.imu(*sample(20, late_s=10)) == []
    assert told(cycle.imu(*sample(20))) == ["pointing", "cue started"]
    assert cycle.imu(*sample(20.02)) == []


def test_without_autostart_samples_begin_nothing() -> None:
    cycle = life_cycle(localize=True)
    cycle.begin(0)
    cycle.pose(*pose())
    assert cycle.imu(*sample(10)) == []
    assert cycle.state == "idle"


def test_samples_that_are_back_after_a_silence_begin_again() -> None:
    cycle = eager()
    cycle.pose(*pose())
    cycle.imu(*sample(1))
    outputs = cycle.tick(4 * S)
    assert told(outputs) == ["idle", "cue stopped"]
    assert shown(outputs).next_step == user_messages.BY_ITSELF
    assert told(cycle.imu(*sample(4.1))) == ["pointing", "cue started"]


@pytest.mark.parametrize("gesture", ["press", "hold"])
def test_who_stopped_with_the_button_begins_with_the_button(gesture: Gesture) -> None:
    cycle = eager()
    cycle.pose(*pose())
    cycle.imu(*sample(1))
    outputs = cycle.button(*press(2, gesture))
    assert told(outputs) == ["idle", "cue stopped"]
    assert shown(outputs).next_step == user_messages.PRESS
    assert cycle.imu(*sample(100)) == []
    assert told(cycle.button(*press(101))) == ["pointing", "cue started"]
    cycle.tick(200 * S)
    assert told(cycle.imu(*sample(201))) == ["pointing", "cue started"]


def test_an_anchor_while_waiting_does_not_keep_samples_from_beginning_afterwards() -> None:
    cycle = eager()
    cycle.pose(*pose())
    assert told(cycle.button(*press(1, "double"))) == ["anchor", "localizing", "cue started"]
    assert cycle.imu(*sample(2)) == []
    assert told(cycle.button(*press(3))) == ["cancel", "idle", "cue stopped"]
    assert told(cycle.imu(*sample(4))) == ["pointing", "cue started"]


def test_localizing_unasked_waits_for_the_place_and_after_a_failure() -> None:
    cycle = eager(localize=True)
    assert cycle.imu(*sample(0.5)) == []  # a place may be on its way
    assert told(cycle.imu(*sample(1.1))) == ["start", "localizing", "cue started"]
    outputs = cycle.on_start_failed(cycle.run, "there is no map yet", 2 * S)
    assert shown(outputs).next_step == user_messages.BY_ITSELF_AT_LAMP
    assert cycle.imu(*sample(6.9)) == []
    assert told(cycle.imu(*sample(7.1)))[:2] == ["start", "localizing"]
    cycle.localization(*news(8, "refused"))
    assert cycle.imu(*sample(12.9)) == []
    assert told(cycle.imu(*sample(13.1)))[:2] == ["start", "localizing"]
    for now_s in range(14, 73):
        cycle.imu(*sample(now_s))
    cycle.imu(*sample(73))
    assert told(cycle.tick(round(73.2 * S))) == ["cancel", "idle", "cue refused"]
    assert cycle.imu(*sample(78)) == []
    assert told(cycle.imu(*sample(78.3)))[:2] == ["start", "localizing"]
    assert told(cycle.button(*press(80))) == ["cancel", "idle", "cue stopped"]
    assert cycle.imu(*sample(100)) == []
