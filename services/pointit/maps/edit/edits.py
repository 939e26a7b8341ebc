"""Edits of a map: what changes in which entry of which section, in the words of the file."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from pointit.maps.model import ENTRIES

Section = Annotated[str, Field(pattern=f"^({'|'.join(name for name in ENTRIES if name != 'links')})$")]
"""A section of named entries."""

EntryName = Annotated[str, Field(min_length=1, max_length=64)]
Key = Annotated[str, Field(min_length=1, max_length=64)]


class _Edit(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    section: Section
    name: Annotated[EntryName, Field(description="in the file as it is, also beside a `rename`")]


class SetValue(_Edit):
    """Set the value of a key, or remove the key if it is None."""

    op: Literal["set"] = "set"
    key: Key
    value: Any


class Add(_Edit):
    """Add an entry at the end of its section."""

    op: Literal["add"] = "add"
    value: dict[Key, Any]


class Remove(_Edit):
    """Remove an entry. What refers to it stays."""

    op: Literal["remove"] = "remove"


class Rename(_Edit):
    """Rename an entry, in what refers to it, too."""

    op: Literal["rename"] = "rename"
    to: EntryName


Edit = Annotated[SetValue | Add | Remove | Rename, Field(discriminator="op")]
"""All edits of one batch name entries as they are in the file, so that two can swap their names."""
