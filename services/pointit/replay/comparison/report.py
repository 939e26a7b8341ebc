"""The result of a comparison, as data."""

from typing import Any

from pydantic import Field

from pointit.schemas import SchemaModel


class FieldReport(SchemaModel):
    """Differences in one field of a topic's messages."""

    field: str
    differ: int = Field(description="messages in which it differs by more than the tolerance")
    largest: float | None = Field(description="largest difference, s for times; None if it is no number")


class Divergence(SchemaModel):
    """The first message of a topic that differs."""

    time_ns: int = Field(description="time in the recording, Unix ns")
    key: str
    fields: tuple[str, ...] = Field(description="those that differ; empty if one of the two is missing")
    recorded: dict[str, Any] | None = Field(description="None if only the replay has it")
    replayed: dict[str, Any] | None = Field(description="None if only the recording has it")


class TopicReport(SchemaModel):
    """Differences in one key."""

    key: str
    recorded: int = Field(description="messages in the recording")
    replayed: int = Field(description="messages of the replay")
    differ: int = Field(description="pairs of messages that differ by more than the tolerances")
    only_recorded: int
    only_replayed: int
    shift_s: float = Field(description="largest difference of the times of two paired messages")
    fields: tuple[FieldReport, ...] = Field(description="the most frequent first")
    first: Divergence | None

    @property
    def is_same(self) -> bool:
        """Return True if no message differs or is missing."""
        return not (self.differ or self.only_recorded or self.only_replayed)


class Report(SchemaModel):
    """All recomputed topics of a recording, in the order of their keys."""

    topics: tuple[TopicReport, ...]

    @property
    def is_same(self) -> bool:
        """Return True if no topic differs."""
        return all(topic.is_same for topic in self.topics)

    @property
    def first(self) -> Divergence | None:
        """Return the earliest divergence, or None."""
        found = [topic.first for topic in self.topics if topic.first is not None]
        return min(found, key=lambda each: each.time_ns, default=None)
