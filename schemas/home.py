"""The set-up of a home: the request of its cards, and what they show."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from pointit.schemas.base import Extent, Id, KeyNameOrEmpty, Many, Query, Real, Reply, SchemaModel
from pointit.schemas.pointing import StepChoice

HomeStep = Literal["connect", "choose", "hand", "place", "try", "done"]
"""Card of the set-up: the Home Assistant, the lamps, what points, where the lamps are, a trial; or none."""
HomeHand = Literal["", "phone", "wrist", "mouse"]
HomePlace = Literal["", "A", "B"]
HomeAct = Literal[
    "read", "connect", "without", "choose", "show", "hand", "press", "take_back", "walk", "stay", "skip",
    "align", "stand", "finish", "go"
]  # fmt: skip
"""Act of the person at the cards, see `SetUpHome.act`."""
HomeQuality = Literal["", "good", "fair", "again"]
HomeKind = Literal[
    "lamp", "ceiling", "strip", "spot", "plug", "fan", "cover", "media", "scene", "danger", "other"
]
"""What a thing of a home is. danger: switching it unseen can do harm, such as a garage door."""
HomeChoice = Literal[
    "",
    "walk",
    "stay",
    "take_back",
    "skip",
    "finish",
    "beside",
    "mistaken",
    "met",
    "other",
    "repeat",
    "exchange",
]
"""What a person may choose at their next step, or correct, see `SetUpHome.choice`."""
MAX_URL = 300
MAX_SENTENCE = 500
TOKEN_FILE = "home-assistant.token"  # noqa: S105 - a name
"""Name of the file with the token in the folder of a home."""
PASSWORD_FILE = "mqtt.password"  # noqa: S105 - a name
"""Name of the file with the password of the broker there."""
NEW_SECRET = ".new-secret"  # noqa: S105 - a suffix
"""Suffix there of files with a token or password that nobody has accepted yet."""
STRIP = "strip:"
LAMP = "lamp:"
"""Begin of the ids of lights of the map, which are no entities of Home Assistant."""


class SetUpHome(Query):
    """One act of a person at the cards that set up a home."""

    version: ClassVar[int] = 3

    act: Annotated[
        HomeAct,
        Field(
            description="read: nothing; connect: to the Home Assistant or broker at `url`; without: there is "
            "none; choose: the lamps `lamps`; show: light the lamp `lamps[0]`; hand: `user` points with "
            "`hand`; press: the person points at the lamp whose turn it is; take_back: the last press; "
            "walk: they are at the second place; stay: there is only one; skip: leave out the lamp of the "
            "turn; align: find the heading by a lamp; stand: they are at `place`; finish: the trial is "
            "over; go: to the card `step`"
        ),
    ] = "read"
    url: Annotated[
        str,
        Field(
            max_length=MAX_URL,
            description="of Home Assistant, as in a browser, or mqtt://USER@HOST of a broker",
        ),
    ] = ""
    lamps: Annotated[Many[Id], Field(description="ids as in `HomeLamp`")] = ()
    hand: HomeHand = ""
    user: Id = ""
    place: HomePlace = ""
    step: HomeStep | None = None
    secret: Annotated[
        KeyNameOrEmpty,
        Field(
            description="name, without its suffix, of the file in the folder of the home with the token or "
            "password for `url`; it is stored once it was accepted. Empty: the stored one is for it",
        ),
    ] = ""
    choice: Annotated[
        HomeChoice,
        Field(
            description="with the act read: walk to finish as the acts; beside: the newest press counts, its "
            "lamp is right beside the one that was pressed there; mistaken: it counts, that one comes again; "
            "met: the lamp that is tried reacted; other: another one did, so that both are exchanged, or the "
            "tried one is pointed at again; repeat: `lamps[0]` is pointed at once more from `place`; "
            "exchange: `lamps` are two whose places are exchanged"
        ),
    ] = ""


class HomeLamp(SchemaModel):
    """A lamp, or anything else that can be pointed at."""

    id: Annotated[
        Id, Field(description="entity of Home Assistant, or `strip:NAME` and `lamp:NAME` of the map")
    ]
    label: Id = ""
    area: Id = ""
    state: Annotated[Id, Field(description="on, off, unavailable and the like; empty if it says none")] = ""
    is_chosen: bool = False
    is_new: Annotated[bool, Field(description="it was not there when lamps were chosen last")] = False
    is_placed: bool = False
    places: Annotated[int, Field(ge=0, le=2, description="number of places from which it was pointed at")] = 0
    direction_sigma_rad: Annotated[
        Extent | None,
        Field(description="of the angle to it from the places, worst; None if it is not placed"),
    ] = None
    quality: Annotated[
        HomeQuality,
        Field(description="how well its direction is known; again: point at it again. Empty: not measured"),
    ] = ""
    kind: Annotated[HomeKind, Field(description="what it is, from its entity and device class")] = "other"
    is_met: Annotated[bool, Field(description="it has reacted when it was meant, since it was placed")] = (
        False
    )
    reason: Annotated[
        str, Field(max_length=500, description="why it is not placed; a sentence, or empty")
    ] = ""


class HomeSetup(Reply):
    """The state of the set-up."""

    version: ClassVar[int] = 3

    max_bytes: ClassVar[int] = 1024 * 1024
    """Room for some 4000 lamps with usual names."""

    step: HomeStep
    url: Annotated[str, Field(max_length=MAX_URL)] = ""
    has_token: bool = False
    is_connected: bool = False
    problem: Annotated[
        str, Field(max_length=500, description="why it cannot go on; a sentence, or empty")
    ] = ""
    lamps: Annotated[
        Many[HomeLamp], Field(description="all that can be chosen in the step choose, else the chosen ones")
    ] = ()
    hand: HomeHand = ""
    user: Id = ""
    place: Annotated[HomePlace, Field(description="where the person is to stand")] = ""
    target: Annotated[Id, Field(description="lamp whose turn it is; empty if none")] = ""
    end: Annotated[Literal["", "first", "last"], Field(description="end of a strip whose turn it is")] = ""
    is_aligning: Annotated[
        bool,
        Field(description="its direction is known: the press finds the zero of the person's device again"),
    ] = False
    may_walk: Annotated[bool, Field(description="all lamps were pointed at from the first place")] = False
    can_take_back: bool = False
    is_lit: Annotated[bool, Field(description="the lamp whose turn it is shows it by its light")] = False
    map: Annotated[
        str, Field(max_length=4096, description="path of the map that the site should use now")
    ] = ""
    places_m: Annotated[Many[tuple[Real, Real]], Field(description="where the person stood, {W}")] = ()
    poses: Annotated[int, Field(ge=0, description="number of poses so far, by which a new one is told")] = 0
    pose_m: Annotated[tuple[Real, Real] | None, Field(description="where the person stands, {W}")] = None
    pose_yaw_rad: Annotated[Real, Field(description="azimuth of {H} there")] = 0.0
    advice: Annotated[
        Many[Annotated[str, Field(max_length=500)]],
        Field(description="sentences on lamps that cannot be used, and on names that are confused"),
    ] = ()
    next_step: Annotated[
        str, Field(max_length=MAX_SENTENCE, description="of the person, as their phone says it; or empty")
    ] = ""
    choices: Annotated[
        Many[StepChoice], Field(description="values of `SetUpHome.choice` at this step, the usual one first")
    ] = ()
    tried: Annotated[Id, Field(description="lamp that is tried now; or empty")] = ""
    beside: Annotated[
        Id, Field(description="lamp at which the arm still points after the newest press; or empty")
    ] = ""
    is_short_walk: Annotated[bool, Field(description="the presses say that the person has hardly walked")] = (
        False
    )
    is_waiting: Annotated[
        bool, Field(description="the home does not answer; it goes on by itself when it does")
    ] = False
    may_repeat: Annotated[
        Many[HomePlace], Field(description="places from which a lamp can be pointed at once more")
    ] = ()
    goes_off: Annotated[
        bool,
        Field(description="the lamp of the turn was lit without a report of its state: it is off afterwards"),
    ] = False
