"""Ids have a length, so that no message that repeats one outgrows what its writer may send."""

from collections.abc import Iterator
from typing import Any, cast

import msgpack
import pytest

from pointit.schemas import Claim, DecodeError, SelectionEvent, decode, encode
from pointit.schemas.base import MAX_ID
from pointit.schemas.catalogue.asyncapi import Kind
from pointit.schemas.catalogue.catalogue import all_kinds
from pointit.schemas.catalogue.example import example

SENTENCES = {"next_step", "message", "reason", "refusal", "text", "warnings"}
"""Texts for people, that are no ids."""

DOCUMENTS = {"command", "parameters", "query", "reply"}
"""JSON, and commands to show: only who runs the site writes them."""


def texts(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of each text in a message."""
    if isinstance(value, str):
        yield path
    elif isinstance(value, dict):
        for name, each in cast("dict[str, Any]", value).items():
            yield from texts(each, (*path, name))
    elif isinstance(value, list):
        for place, each in enumerate(cast("list[object]", value)):
            yield from texts(each, (*path, place))


@pytest.mark.parametrize("kind", all_kinds(), ids=lambda kind: kind.__name__)
def test_every_text_that_is_no_sentence_is_bounded(kind: Kind) -> None:
    for path in texts(msgpack.unpackb(encode(example(kind)))):
        (field,) = [name for name in path if isinstance(name, str)][-1:]
        if field in SENTENCES | DOCUMENTS:
            continue
        message = msgpack.unpackb(encode(example(kind)))
        part = message
        for step in path[:-1]:
            part = part[step]
        part[path[-1]] = "x" * (MAX_ID + 1)
        with pytest.raises(DecodeError, match=rf"{kind.__name__}: {path[0]}.*\(got 'xxx"):
            decode(kind, msgpack.packb(message))


def test_an_event_about_the_longest_id_can_be_sent() -> None:
    claim = Claim(stamp_ns=1, object_id="\N{EARTH GLOBE EUROPE-AFRICA}" * MAX_ID, wish="toggle")
    event = SelectionEvent(
        stamp_ns=1,
        event="refused",
        object_id=claim.object_id,
        kind=claim.object_id,
        user="anna",
        reason=f"{claim.object_id} has left",
    )
    assert len(encode(event)) < SelectionEvent.max_bytes / 4
