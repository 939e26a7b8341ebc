"""Messages only grow: errors for a developer who changes one."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import msgpack
import pytest
from pydantic import Field, create_model

from pointit.schemas import Message, SchemaError, SchemaModel, decode
from pointit.schemas.catalogue.catalogue import breaking_changes, check_committed, generate, updated_files


class Wheel(SchemaModel):
    """A wheel."""

    radius_m: Annotated[float, Field(gt=0, description="of the tyre")] = 0.3
    title: str = ""


class Cart(Message):
    """Something that rolls."""

    front: Wheel
    wheels: tuple[Wheel, ...] = ()
    mood: Literal["calm", "brisk"] = "calm"
    place_m: tuple[float, float] = (0.0, 0.0)
    driver: str | None = None


COMMITTED = generate([Cart])


def cart(version: int = 1, *, doc: str | None = None, **fields: Any) -> type[Message]:
    """Return Cart with changes: fields are (annotation, default), `...` requires one, None drops it."""
    now: dict[str, Any] = {
        "front": (Wheel, ...),
        "wheels": (tuple[Wheel, ...], ()),
        "mood": (Literal["calm", "brisk"], "calm"),
        "place_m": (tuple[float, float], (0.0, 0.0)),
        "driver": (str | None, None),
        **fields,
    }
    kept = {name: field for name, field in now.items() if field is not None}
    kind: type[Message] = create_model("Cart", __base__=Message, __doc__=doc or Cart.__doc__, **kept)
    kind.version = version
    return kind


def part(**fields: Any) -> Any:
    """Return Wheel with changes."""
    now: dict[str, Any] = {"radius_m": (Annotated[float, Field(gt=0)], 0.3), "title": (str, ""), **fields}
    return create_model("Wheel", __base__=SchemaModel, **now)


def several(kind: Any) -> Any:
    """The annotation of any number of `kind`."""
    return tuple.__class_getitem__((kind, ...))


def merged(*layers: Mapping[str, bytes]) -> dict[str, bytes]:
    return {path: content for layer in layers for path, content in layer.items()}


def test_an_unchanged_message_needs_nothing() -> None:
    assert check_committed(COMMITTED, [Cart]) == []
    assert updated_files(COMMITTED, [Cart]) == {}
    assert breaking_changes(*[Cart.model_json_schema()] * 2) == []


def test_a_missing_file_is_written_and_named() -> None:
    committed = {path: content for path, content in COMMITTED.items() if path != "messages/Cart.v1.json"}
    committed.pop("samples/Cart.v1.msgpack")
    assert set(updated_files(committed, [Cart])) == {"messages/Cart.v1.json", "samples/Cart.v1.msgpack"}
    (problem,) = check_committed(committed, [Cart])
    assert "messages/Cart.v1.json, samples/Cart.v1.msgpack; run `pointit topic schema --write`" in problem


def test_added_field_asks_for_a_version_and_names_the_command() -> None:
    changed = cart(colour=(str, ""))
    with pytest.raises(
        SchemaError, match=r"^Cart\.v1 has changed.*raise `version` of Cart to 2 and run"
    ) as caught:
        updated_files(COMMITTED, [changed])
    assert "`pointit topic schema --write` again" in str(caught.value)
    assert check_committed(COMMITTED, [changed]) == [str(caught.value)]


def test_added_field_of_a_part_requires_a_new_message_version() -> None:
    grown = part(spokes=(int, 0))
    parts: dict[str, Any] = {"front": (grown, ...), "wheels": (several(grown), ())}
    assert "raise `version` of Cart to 2" in check_committed(COMMITTED, [cart(**parts)])[0]
    assert updated_files(COMMITTED, [cart(2, **parts)])


def test_a_raised_version_is_written_beside_the_old_one() -> None:
    grown = cart(2, colour=(str, ""))
    written = updated_files(COMMITTED, [grown])
    assert set(written) >= {"messages/Cart.v2.json", "samples/Cart.v2.msgpack"}
    assert not {"messages/Cart.v1.json", "samples/Cart.v1.msgpack"} & set(written)
    both = merged(COMMITTED, written)
    assert check_committed(both, [grown]) == []
    assert (
        "raise `version` of Cart to 3"
        in check_committed(both, [cart(2, colour=(str, ""), weight_kg=(float, 0.0))])[0]
    )
    old = decode(grown, COMMITTED["samples/Cart.v1.msgpack"], "Cart.v1")
    assert msgpack.unpackb(COMMITTED["samples/Cart.v1.msgpack"])["stamp_ns"] == old.model_dump()["stamp_ns"]


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize(
    ("fields", "clause"),
    [
        ({"driver": None}, "the field driver is gone"),
        ({"front": None}, "the field front is gone"),
        ({"colour": (str, ...)}, "the field colour is required now, give it a default"),
        ({"mood": (Literal["calm", "brisk"], ...)}, "the field mood is required now"),
        ({"mood": (Literal["calm", "brisk", "wild"], "calm")}, "the field mood changed (enum: "),
        ({"driver": (int | None, None)}, "the field driver changed (type: 'string' before, 'integer' now)"),
        ({"driver": (str, "")}, "the field driver changed"),
        ({"place_m": (tuple[float, float, float], (0.0, 0.0, 0.0))}, "the field place_m changed"),
        ({"place_m": (tuple[float, int], (0.0, 0))}, "the field place_m changed (type: 'number' before"),
        (
            {"front": (part(radius_m=(Annotated[float, Field(gt=1)], 2.0)), ...)},
            "the field front.radius_m changed",
        ),
        ({"front": (part(title=(bytes, b"")), ...)}, "the field front.title changed"),
        ({"wheels": (several(part(title=(int, 0))), ())}, "the field wheels.title changed"),
    ],
)
def test_anything_else_is_a_new_message(version: int, fields: dict[str, Any], clause: str) -> None:
    with pytest.raises(SchemaError) as caught:
        updated_files(COMMITTED, [cart(version, **fields)])
    assert str(caught.value).startswith("Cart may only grow from Cart.v1, but the field ")
    assert clause in str(caught.value)
    assert str(caught.value).endswith("undo that, or make it a new message")


def test_a_default_changes_with_a_version_only() -> None:
    assert "raise `version` of Cart to 2" in check_committed(COMMITTED, [cart(driver=(str | None, "me"))])[0]
    assert updated_files(COMMITTED, [cart(2, driver=(str | None, "me"))])


def test_prose_may_change_at_any_time() -> None:
    reworded = cart(doc="Something that rolls, or stands.")
    assert set(updated_files(COMMITTED, [reworded])) == {"messages/Cart.v1.json"}


def test_samples_that_are_there_are_never_written_again() -> None:
    committed = merged(COMMITTED, {"samples/Cart.v1.msgpack": b"as some older sender sent it"})
    assert updated_files(committed, [Cart]) == {}


@pytest.mark.parametrize(
    ("version", "sentence"),
    [
        (3, "Cart has version 3, but Cart.v1 is the newest: raise `version` by one"),
        (0, "Cart has version 0, but Cart.v1 is committed: versions never go back"),
    ],
)
def test_versions_rise_by_one(version: int, sentence: str) -> None:
    assert check_committed(COMMITTED, [cart(version)]) == [sentence]


def test_a_message_does_not_vanish() -> None:
    (problem,) = check_committed(COMMITTED, [])
    assert problem.startswith("Cart is in the catalogue and in no row of the topic table")


@pytest.mark.parametrize(
    ("lost", "sentence"),
    [
        ("samples/Cart.v1.msgpack", "messages/Cart.v1.json has lost its sample"),
        ("messages/Cart.v1.json", "samples/Cart.v1.msgpack has lost its schema"),
    ],
)
def test_old_versions_keep_both_files(lost: str, sentence: str) -> None:
    grown = cart(2, colour=(str, ""))
    both = merged(COMMITTED, updated_files(COMMITTED, [grown]))
    del both[lost]
    assert any(problem.startswith(sentence) for problem in check_committed(both, [grown]))


def test_strange_files_are_named() -> None:
    committed = merged(COMMITTED, {"messages/notes.txt": b"", "samples/Cart.v1.json": b"{}"})
    assert check_committed(committed, [Cart]) == [
        "messages/notes.txt is no file of the catalogue: delete it",
        "samples/Cart.v1.json is no file of the catalogue: delete it",
    ]


@pytest.mark.parametrize("content", [b"", b"{", b"\xff", b"[]", b"3"])
def test_a_broken_schema_file_is_named(content: bytes) -> None:
    with pytest.raises(SchemaError, match=r"^messages/Cart\.v1\.json: is not .*restore it from git"):
        check_committed(merged(COMMITTED, {"messages/Cart.v1.json": content}), [Cart])
