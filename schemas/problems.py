"""Problems that services report in their health, and the codes by which diagnosis finds causes."""

from typing import Annotated, Literal

from pydantic import Field

from pointit.schemas.base import SchemaModel
from pointit.schemas.text import hide_secrets

Severity = Literal["warning", "note"]

CLOCK = "clock"
CLOCK_LIMIT = "clock-limit"
DENIED = "denied"
HANDLER = "handler"
INVALID = "invalid"
LATE = "late"
IDLE_ARM = "nobody"
ROUTER_LOST = "router-lost"
TWICE = "twice"
UNCERTAIN = "uncertain"
UNWRITABLE = "unwritable"
EVENT_LOOP = "event-loop"
REVOKED = "revoked"
OTHER = "other"
CLOCK_CLAIM = "clock-claim"
EXCESS = "excess"
REFUSED_ACTS = "refused-acts"
VOICE = "voice"
NO_DATA = ("link", "port", "silent", "sensor", "sensors", "number")
"""Codes of a source from which nothing comes."""
SILENCING = (*NO_DATA, "connection", "silence", IDLE_ARM)
"""Codes of a service that writes nothing because of its device."""
CODES = {
    CLOCK: "the clock of machine `subject` is ahead or behind",
    CLOCK_LIMIT: "the same, by so much that messages are refused",
    CLOCK_CLAIM: "only one person's services say that the clock of machine `subject` is wrong",
    DENIED: "identity `subject` lacks a right",
    REVOKED: "identity `subject` was revoked, or its certificate replaced, and still connects",
    INVALID: "messages on `topic`, the last of writer `subject`, could not be decoded",
    HANDLER: "the service fails on messages on `topic`, the last of writer `subject`",
    LATE: "messages on `topic` came late, or after newer ones",
    IDLE_ARM: "nobody moves the arm yet",
    ROUTER_LOST: "the router at `subject` does not answer",
    TWICE: "process `subject` has the same name",
    UNCERTAIN: "the pose of the person is uncertain",
    UNWRITABLE: "file `subject` cannot be written",
    EVENT_LOOP: "`subject` blocks the event loop of its process",
    EXCESS: "identity `subject` writes more than is permitted",
    VOICE: "names are announced to person `subject`, or to all, and nobody hears them",
    REFUSED_ACTS: "carrier `subject` cannot carry out acts; if it is a service, its own problem tells why",
    OTHER: "a sentence of a writer of an older release",
    **dict.fromkeys(SILENCING[:-1], "nothing comes from the device, or over its connection"),
}
"""Meaning of each code that means the same in every service. All others are their service's own."""

NAMES_SPOKEN = "names spoken"
"""Metric of services that speak what is announced: the number of names since the start."""
MAX_CODE = 64
"""Maximum length of a code, characters."""
MAX_SUBJECT = 256
"""Maximum length of a subject, characters."""


class Problem(SchemaModel):
    """What is wrong with a service, or with what it depends on, and what to do about it.

    A service reports it with `ServiceBus.warn`, and `pointit doctor`, the page and Foxglove show it. Programs
    match `code`, `subject` and `topic`, which say what kind of problem it is and what it is about. People
    read the `sentence`, which may have figures that change: two reports are the same problem if their
    `identity` is equal.

    `severity` "note" says that nothing is wrong and nothing happens, either, such as an arm that nobody
    moves.
    """

    code: Annotated[str, Field(min_length=1, max_length=MAX_CODE)]
    sentence: Annotated[str, Field(description="the problem and its remedy")]
    subject: Annotated[
        str, Field(max_length=MAX_SUBJECT, description="machine, identity, writer, process or part, or empty")
    ] = ""
    topic: Annotated[str, Field(max_length=MAX_SUBJECT, description="its key pattern, or empty")] = ""
    severity: Annotated[Severity, Field(description="note: nothing is wrong, but nothing happens")] = (
        "warning"
    )

    @property
    def identity(self) -> tuple[str, ...]:
        """Return the key of the problem, without figures that change with time.

        >>> slow = Problem(code="slow", sentence="cursors are 300 ms old: close other programs")
        >>> slower = slow.model_copy(update={"sentence": "cursors are 900 ms old: close other programs"})
        >>> slow.identity == slower.identity
        True
        """
        # only a problem without a code is known by its sentence alone
        sentence = self.sentence if self.code == OTHER else ""
        return (self.code, self.subject, self.topic, sentence)

    def without_secrets(self) -> "Problem":
        """Return it with a sentence that may be published."""
        return self.model_copy(update={"sentence": hide_secrets(self.sentence)})
