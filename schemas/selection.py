"""Selected and reserved objects, acts on things and their results."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from pointit.schemas.base import Count, Fraction, Id, KeyName, KeyNameOrEmpty, Many, Message, Ns, SchemaModel
from pointit.schemas.environment import ThingMode

SelectsBy = Literal["stay", "press"]
"""Trigger that selects the object that a person points at: staying on it, or a press."""
TargetState = Literal["", "on", "off", "unknown", "unavailable"]
ResultKind = Literal["done", "failed", "started"]
"""`started`: it runs for long, and `done` or `failed` follows."""
ActStatus = Literal["asked", "pending", "done", "failed", "unanswered"]
"""What is known of an act. `asked`: its carriers were told, nothing else. `pending`: they have told that it
has started. `unanswered`: they did not tell the result in time, so that nobody knows it."""
FailureCode = Literal["", "unavailable", "refused", "no_effect", "no_answer", "busy", "replaced", "error"]
"""Kind of a failure: not reachable; not allowed or not possible; nothing changed; not in time; too many at
once; a newer act replaced it; a fault."""

RESTORED = "was on before a restart"  # in the reason of an event, to which nothing reacts
REPORTED = "as its target has it"
"""Reason of an event to which nothing reacts: the state that the target of a thing reported first."""
NOT_DONE = "not done: "
"""Beginning of the reason of an event that takes back an act that failed."""
MAX_PRESSED = 4
"""Maximum number of named objects that want a press: more are told by their number."""

BEGIN_WITHIN_S = 6.0
"""Time after which the selector gives up an act that its carriers have not begun, s."""

REPEATED_REASON = "told again after a restart of the selector"
"""Reason of an event that subscribers may have received before: same object, event, stamp and number."""

MAX_ACT_S = 3600.0
"""Maximum limit of an act, s."""
LifeNs = Annotated[
    Ns,
    Field(
        description="start of this life of the carrier, which names it; 0 if it does not count its reports"
    ),
]
ReportNumber = Annotated[
    Count,
    Field(description="counts the reports of this life, results and states together: a larger one is newer"),
]


class SelectedObject(SchemaModel):
    """One selected object."""

    id: Id
    user: KeyName
    since_ns: Ns
    kind: Id = ""
    confidence: Annotated[
        Fraction | None, Field(description="probability that it was meant among nearby objects, or None")
    ] = None
    is_pending: Annotated[
        bool, Field(description="its carriers have not told yet that it is on or has started")
    ] = False


class ReservedObject(SchemaModel):
    """An object that a person is about to select. To others it is not available."""

    id: Id
    user: KeyName
    until_ns: Annotated[Ns, Field(description="free again then, unless held on")]


class ActState(SchemaModel):
    """An act of a person on an object, and what is known of it. The object and `event_ns` identify it."""

    object_id: Id
    user: Annotated[KeyNameOrEmpty, Field(description="person who did it")] = ""
    event_ns: Annotated[Ns, Field(description="stamp of its `SelectionEvent`")]
    asked_ns: Annotated[
        Ns, Field(description="stamp of the cursor, press or request that asked for it: `act_ns` of a hover")
    ]
    effect: Annotated[
        Literal["", "select", "deselect"], Field(description="what it is to do; empty if it was refused")
    ] = ""
    status: ActStatus
    code: Annotated[FailureCode, Field(description="kind of the failure; empty if it has not failed")] = ""
    text: Annotated[str, Field(description="cause of the failure, and the remedy")] = ""


class Selection(Message):
    """Everything that is selected now, and what is known of the acts that led to it."""

    version: ClassVar[int] = 5

    max_bytes: ClassVar[int] = 512 * 1024
    """Room for all objects that can be tracked."""

    objects: Many[SelectedObject] = ()
    reserved: Many[ReservedObject] = ()
    acts: Annotated[
        Many[ActState], Field(description="last acts of each person on each object, the newest last")
    ] = ()
    undoable: Annotated[
        Many[KeyName], Field(description="people who have done something that `undo` can take back")
    ] = ()
    method: Annotated[Id | None, Field(description="method of selecting in use, told where shards run")] = (
        None
    )
    dwell_s: Annotated[
        float | None, Field(gt=0, description="time on an object that selects it, told where shards run, s")
    ] = None

    @property
    def settled(self) -> tuple[SelectedObject, ...]:
        """Return what is selected, without objects whose carriers have not told so yet."""
        return tuple(item for item in self.objects if not item.is_pending)

    @property
    def under_way(self) -> frozenset[str]:
        """Return the ids of the objects with an act whose result is not told, so that none is on or off."""
        pending = {item.id for item in self.objects if item.is_pending}
        acts = {act.object_id for act in self.acts if act.status in ("asked", "pending")}
        return frozenset(pending | acts)


class SelectionManner(Message):
    """The way in which people select here, for those who tell them: each person's supervisor, and pages."""

    by: SelectsBy
    pressed: Annotated[
        Many[Id], Field(description="names of objects that want a press, where others do not; a few at most")
    ] = ()
    pressed_count: Annotated[int, Field(ge=0, description="number of these objects")] = 0
    names_by: Annotated[
        SelectsBy | None, Field(description="for people who hear names of objects; None if nobody does")
    ] = None


class SelectionEvent(Message):
    """Something happened to an object: a person (de)selected it, or it left."""

    version: ClassVar[int] = 5

    event: Literal["selected", "deselected", "refused", "left", "dispatched"]
    object_id: Id
    kind: Id = ""
    user: Annotated[
        KeyNameOrEmpty,
        Field(description="acting person; of `left` and `dispatched`: for whom it went there, or empty"),
    ] = ""
    reason: str = ""
    bay: Annotated[Id, Field(description="of `dispatched`: where it went")] = ""
    cause: Annotated[
        Literal["", "dwell", "button", "undo", "clear", "release"],
        Field(description="action of the person; empty if none or unknown"),
    ] = ""
    confidence: Annotated[Fraction | None, Field(description="that this object was meant")] = None
    carriers: Annotated[
        Many[KeyName],
        Field(description="services that carry it out: an `ActOutcome` follows. Empty: it is done"),
    ] = ()
    status: Annotated[
        ActStatus | None, Field(description="state of its act; None in old recordings, where `carriers` tell")
    ] = None
    begin_within_s: Annotated[
        float | None,
        Field(
            gt=0,
            description="time after which the selector gives the act up if it is not begun, by its clock, s. "
            "Each carrier asks it by `BeginAct` before it begins. None: nobody is to be asked",
        ),
    ] = None

    @property
    def thing(self) -> str:
        """Id of the object, for programs that react to things of the map."""
        return self.object_id

    @property
    def is_on(self) -> bool:
        """True if it was selected, False if a switch went off."""
        return self.event == "selected"

    @property
    def takes_back(self) -> bool:
        """True if it takes back an act that failed, which the outcome of the act has told."""
        return self.reason.startswith(NOT_DONE)

    def is_reaction(self, mode: ThingMode) -> bool:
        """Return True if a thing of `mode` fired, or was switched; not if it was restored, or is over."""
        if RESTORED in self.reason or REPORTED in self.reason:
            return False
        is_switched_off = (mode, self.event) == ("switch", "deselected")
        return self.is_on or is_switched_off


class Claim(Message):
    """A person served by a shard of the selector wants an object. The site's selector decides.

    The event of its decision has the stamp of a claim to toggle.
    """

    object_id: Id
    wish: Annotated[
        Literal["reserve", "toggle"], Field(description="keep it for them for a moment, or (de)select it")
    ]
    action: Annotated[
        Literal["select", "deselect"] | None,
        Field(description="effect of `toggle` that is meant; refused if it has another one by then"),
    ] = None
    cause: Annotated[Literal["dwell", "button"], Field(description="action of the person")] = "dwell"
    confidence: Annotated[Fraction | None, Field(description="that this object was meant")] = None


class ActResult(Message):
    """Result of an act by one carrier. The act is the selection event of this object with this stamp."""

    version: ClassVar[int] = 2

    object_id: Id
    event_ns: Ns
    result: ResultKind
    state: Annotated[TargetState, Field(description="state of the thing after it")] = ""
    code: FailureCode = ""
    text: Annotated[str, Field(max_length=500, description="cause of the failure, and the remedy")] = ""
    life_ns: LifeNs = 0
    report: ReportNumber = 0


class ThingState(SchemaModel):
    """The state that the target of a thing reports."""

    id: Id
    state: Annotated[TargetState, Field(description="empty: it can be used, and has no state")] = ""
    reason: Annotated[
        str, Field(max_length=500, description="cause if it is unavailable, and the remedy")
    ] = ""
    is_starting: Annotated[
        bool, Field(description="unavailable only until the system that it belongs to has started")
    ] = False
    limit_s: Annotated[
        float, Field(gt=0, le=MAX_ACT_S, description="time after which an act on it has failed, s")
    ] = 5.0
    last: Annotated[
        ActResult | None, Field(description="result of the last act on it, for readers that begin later")
    ] = None


class ThingStates(Message):
    """All things that a carrier has targets for. An act on one that is unavailable is refused at once."""

    version: ClassVar[int] = 4
    max_bytes: ClassVar[int] = 1024 * 1024

    things: Many[ThingState] = ()
    life_ns: LifeNs = 0
    report: ReportNumber = 0
    asks_first: Annotated[
        bool,
        Field(description="it asks the selector before it begins an act, which is told as such until then"),
    ] = False


class ActOutcome(Message):
    """Result of an act by all its carriers. People are told of success only after it."""

    version: ClassVar[int] = 2

    event: Literal["selected", "deselected"]
    object_id: Id
    kind: Id = ""
    user: KeyNameOrEmpty = ""
    event_ns: Ns
    result: ResultKind
    code: FailureCode = ""
    text: str = ""
    is_repeated: Annotated[
        bool,
        Field(description="told again after a restart of the selector: it may have been told before"),
    ] = False

    @property
    def status(self) -> ActStatus:
        """Return the state of the act that it tells."""
        if self.result == "started":
            return "pending"
        if self.result == "done":
            return "done"
        return "unanswered" if self.code == "no_answer" else "failed"
