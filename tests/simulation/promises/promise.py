"""The promises that simulations check, each with the sentence that makes it and where that stands."""

from dataclasses import dataclass

ACTS = "docs/explanation/acts.md"
SELECTION = "docs/explanation/selection.md"
HERE = "docs/explanation/simulation.md"


@dataclass(frozen=True)
class Promise:
    """A promise of the product."""

    name: str
    sentence: str
    """Literally as it stands in `document`, but for line breaks."""
    document: str


DONE_IS_DONE = Promise(
    "nothing is told as done that was not done",
    "the outcome, when all carriers are done, one has failed, has ended, has not begun within 6 s,",
    ACTS,
)
CUE_AFTER_DONE = Promise(
    "a person is told of success only after it",
    "**Results are reported after step 6**, a failed act as refused.",
    ACTS,
)
REPLY_AFTER_DONE = Promise(
    "a reply tells of success only after it",
    "**Results are reported after step 6**, a failed act as refused.",
    ACTS,
)
FAILED_IS_OVER = Promise(
    "what was told as failed is not begun afterwards", "**What was told as failed is not begun.**", ACTS
)
NOT_TWICE = Promise("no act is carried out twice", "Carriers act on a repeated event only once.", ACTS)
NOT_LATE = Promise(
    "no act is carried out late",
    "the selector gives an act up that was not begun 6 s after its publication, by its own clock",
    ACTS,
)
ONLY_TOLD = Promise(
    "only acts that were told are carried out",
    "An **act** is a selection event with `carriers`",
    ACTS,
)
ONE_RESULT = Promise("an act has one result", "An act ends with one result.", HERE)
KNOWN_OUTCOME = Promise(
    "an outcome is of an event that was told", "Its number is the object and the stamp of the event", ACTS
)
OUTCOME_FOLLOWS = Promise("an outcome follows each act", "**Each act has an outcome**", ACTS)
NOT_PENDING = Promise("no act is pending for ever", "an act without one ends as `no_answer`.", ACTS)
NAMES_CARRIERS = Promise(
    "an act names its carriers",
    "otherwise the event names its carriers",
    ACTS,
)
WAITS_FOR_CARRIERS = Promise(
    "no act without the carriers of its thing", "**No act without the carriers of its thing.**", ACTS
)
GOES_BACK = Promise(
    "a switch that failed goes back",
    "**A switch that failed goes back**, unless its target reports that it did not.",
    ACTS,
)
OWNER_DECIDES = Promise(
    "only its owner ends a claim", "A claim of a person who is present is ended by that person only.", HERE
)
FOLLOWS_TARGET = Promise("a switch follows its target", "**A switch follows its target.**", ACTS)
ONE_OWNER = Promise(
    "one owner at a time", "The site's selector decides as on its own people's cursors.", SELECTION
)
DESELECTS_SELECTED = Promise(
    "only what is selected is deselected",
    "Only what is selected is deselected.",
    HERE,
)
IN_ORDER = Promise("events are in order of their numbers", "Events have numbers, which grow.", HERE)
STAMPS_INCREASE = Promise(
    "stamps of one object's events increase",
    "stamps of the events of one object strictly increase, by any clock",
    ACTS,
)
ONE_EVENT_A_NUMBER = Promise(
    "each number is of one event", "A number belongs to one event, also after a restart.", HERE
)
REPEATED_SAYS_SO = Promise(
    "an event that may come again says so",
    "An event that may have been sent before says so in its reason.",
    HERE,
)
UNDO_IS_EXACT = Promise("undo gives back exactly", "*Undo* gives back exactly what the last step took.", HERE)
UNDO_FIRES_NOTHING = Promise("undo fires no button", "**Undo fires no button**", ACTS)
CAN_SWITCH = Promise(
    "after faults a thing can be switched", "After the last fault, people switch things as before.", HERE
)
OBSERVERS_AGREE = Promise(
    "all observers show the same", "All observers show the same, and what was written last.", HERE
)
OBSERVERS_ARE_CURRENT = Promise(
    "observers show the newest", "All observers show the same, and what was written last.", HERE
)
LIT_FOR_SOMEBODY = Promise(
    "no lamp is lit for nobody", "Lamps and strips are lit for what is selected, and for nothing else.", HERE
)
SELECTED_IS_LIT = Promise(
    "what is selected is lit", "Lamps and strips are lit for what is selected, and for nothing else.", HERE
)
DOCTOR_IS_CONTENT = Promise(
    "doctor is content", "`pointit doctor` finds nothing wrong 30 s after the last fault.", HERE
)
NONE_ENDS = Promise(
    "no service ends by itself", "A service ends when it is asked to, and never by itself.", HERE
)
ENDS_WHEN_ASKED = Promise(
    "a service ends when asked", "A service ends when it is asked to, and never by itself.", HERE
)
NO_TASK_LEFT = Promise("no task is left", "It leaves no task, and each exception is handled.", HERE)
NO_EXCEPTION = Promise("no unhandled exception", "It leaves no task, and each exception is handled.", HERE)
GOES_ON = Promise("the site goes on", "No service computes for ever.", HERE)

PROMISES: tuple[Promise, ...] = tuple(each for each in globals().values() if isinstance(each, Promise))
