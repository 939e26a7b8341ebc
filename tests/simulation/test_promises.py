"""Each promise cites a sentence of the documents, and the page of simulations lists all of them."""

import pytest

from tests.architecture.sources import ROOT
from tests.simulation.faults.drawing import KINDS
from tests.simulation.mistakes import MISTAKES
from tests.simulation.promises.promise import HERE, PROMISES, Promise

PAGE = (ROOT / HERE).read_text()


@pytest.mark.parametrize("promise", [pytest.param(each, id=each.name) for each in PROMISES])
def test_the_sentence_of_a_promise_stands_in_its_document(promise: Promise) -> None:
    text = (ROOT / promise.document).read_text()

    assert promise.sentence in " ".join(text.split())
    assert f"| {promise.name} | " in PAGE


def test_the_page_lists_each_kind_of_fault() -> None:
    for kind in set(KINDS):
        assert f"`{kind}`" in PAGE


def test_each_mistake_names_a_promise_that_it_breaks() -> None:
    assert all(mistake.breaks in PROMISES for mistake in MISTAKES.values())


def test_each_promise_is_broken_by_a_mistake() -> None:
    assert {promise.name for promise in PROMISES} == {mistake.breaks.name for mistake in MISTAKES.values()}
