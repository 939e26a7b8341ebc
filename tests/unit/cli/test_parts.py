"""The tables of what optional rooms bring name objects that exist, of the type that the table states."""

import inspect

import pytest

from pointit.cli.parts import DISPLAY_PARTS, LIVE_VIEWS, PERSON_CHECKS, RUN_PARTS, RunPart
from pointit.cli.summary import DisplayPart
from pointit.launch.plan.plan import WATCHERS
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import OptionalPart, load_object, present


def test_each_part_exists_with_the_type_of_its_table() -> None:
    run = present(RUN_PARTS)
    display = present(DISPLAY_PARTS)
    assert [len(run), len(display)] == [len(RUN_PARTS), len(DISPLAY_PARTS)]
    assert all(isinstance(part, RunPart) for part in run)
    assert all(isinstance(part, DisplayPart) for part in display)
    (view,), (check,), (watcher,) = present(LIVE_VIEWS), present(PERSON_CHECKS), present(WATCHERS)
    assert list(inspect.signature(view).parameters) == ["scenario", "console", "end_s", "looks_on", "parts"]
    assert len(inspect.signature(check).parameters) == 1
    assert len(inspect.signature(watcher).parameters) == 1


def test_part_without_one_of_its_rooms_is_left_out() -> None:
    target = "pointit.runtime.host.extras:present"
    assert present([OptionalPart[object](target), OptionalPart[object](target, ("pointit.absent",))]) == [
        present
    ]
    assert present([OptionalPart[object]("pointit.absent.module:PART")]) == []


def test_object_of_an_absent_room_is_refused_in_one_sentence() -> None:
    with pytest.raises(ConfigError, match=r"this command is not part of this build .* no pointit\.absent"):
        load_object("pointit.absent:command", "this command")
