"""Results of a method of another package: checked before the selector uses them."""

from typing import Any, cast

import pytest

from pointit.services.selector.methods.pointer import GuardedMethod
from pointit.services.selector.selection_methods import PointingSample, SelectionProgress
from tests.unit.selector.room import pointing


class Method:
    """A method whose results are those of a test."""

    def __init__(self, progress: Any, latched: Any = ()) -> None:
        self.progress = progress
        self.latched = latched

    def step(self, _pointing: PointingSample) -> Any:
        return self.progress

    def latch(self, object_id: str) -> None:
        raise AssertionError(object_id)


def at(now_s: float) -> PointingSample:
    return PointingSample(pointing(now_s, 5.0), "a", None, bool)


def stepped(method: Method) -> tuple[GuardedMethod, SelectionProgress]:
    made: Any = method
    guarded = GuardedMethod(lambda: made)
    return guarded, guarded.step(at(1.0))


@pytest.mark.parametrize(
    ("progress", "fault"),
    [
        (SelectionProgress(cast("Any", 7)), "TypeError: object_id 7, expected text or None"),
        (SelectionProgress("a", fired=cast("Any", b"a")), "TypeError: fired b'a', expected text or None"),
        (SelectionProgress("a", 1.5), "ValueError: progress 1.5, expected 0 to 1"),
        (SelectionProgress("a", 0.5, None, -1.0), "ValueError: spent_s -1.0, expected 0 or more"),
        (None, "AttributeError: "),
    ],
)
def test_wrong_result_is_a_fault_and_selects_nothing(progress: SelectionProgress | None, fault: str) -> None:
    guarded, shown = stepped(Method(progress))
    assert guarded.fault.startswith(fault)
    assert shown == SelectionProgress("a")


@pytest.mark.parametrize("latched", [lambda: {"a"}, None, [["a"]]], ids=["method", "none", "lists"])
def test_latched_that_is_no_collection_of_objects_is_a_fault(latched: object) -> None:
    guarded, _ = stepped(Method(SelectionProgress("a"), latched))
    assert guarded.fault == ""
    assert set(guarded.latched) == set()
    assert guarded.fault.startswith("TypeError: ")


def test_method_that_works_for_a_while_counts_as_sound_again() -> None:
    method: Any = Method(None)
    guarded = GuardedMethod(lambda: method)
    guarded.step(at(1.0))
    method.progress = SelectionProgress("a", 0.5)
    assert [guarded.step(at(now_s)).progress for now_s in (1.9, 2.0, 31.9)] == [0.0, 0.5, 0.5]
    assert guarded.fault.startswith("AttributeError: ")
    guarded.step(at(32.1))
    assert guarded.fault == ""


def test_objects_that_are_latched_before_the_first_cursor_are_latched_in_the_method() -> None:
    method: Any = Method(SelectionProgress("a"))
    latched = method.latched = set[str]()
    method.latch = latched.add
    guarded = GuardedMethod(lambda: method)
    for object_id in ("a", "b"):
        guarded.latch(object_id)
    assert set(guarded.latched) == {"a", "b"}
    guarded.step(at(1.0))
    assert latched == {"a", "b"}
