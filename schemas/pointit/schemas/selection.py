"""What is selected, by whom and since when."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from pointit.schemas.base import Many, Message, Ns, Part


class SelectedObject(Part):
    """One selected object."""

    id: str
    user: str
    since_ns: Ns


class Selection(Message):
    """Everything that is selected now."""

    max_bytes: ClassVar[int] = 512 * 1024
    """Room for all objects that can be tracked."""

    objects: Many[SelectedObject] = ()


class SelectionEvent(Message):
    """Something happened to an object: a person (de)selected it, or it left."""

    event: Literal["selected", "deselected", "refused", "left", "dispatched"]
    object_id: str
    kind: str = ""
    user: Annotated[str, Field(description="who did it; for `left`: who had it selected, or empty")] = ""
    reason: str = ""
