"""What is selected, by whom and since when."""

from typing import Annotated, Literal

from pydantic import Field

from pointit.schemas.base import Message, Part


class SelectedObject(Part):
    """One selected object."""

    id: str
    user: str
    since_ns: Annotated[int, Field(ge=0)]


class Selection(Message):
    """Everything that is selected now."""

    objects: tuple[SelectedObject, ...] = ()


class SelectionEvent(Message):
    """Something happened to an object: a person (de)selected it, or it left."""

    event: Literal["selected", "deselected", "refused", "left", "dispatched"]
    object_id: str
    kind: str = ""
    user: Annotated[str, Field(description="who did it; for `left`: who had it selected, or empty")] = ""
    reason: str = ""
