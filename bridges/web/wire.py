"""The wire between the server and its pages; the contract of this folder's Python with `client`'s TypeScript.

One WebSocket, `/ws`, opened with the cookie that `/?token=...` has set and with the page's own origin.

Server to page:

- text, JSON, `{"kind": ...}`: `Hello` once, first; `Status` once a second and when it changes; `Answer` to
  each `Ask`. Their fields are the models below, named as they travel.
- binary, msgpack: a *batch* of what is new on the bus since the batch before, `[n, sent_ns, speed, states,
  events, dropped]`. `n` counts batches from 1; `sent_ns` is the site's time when it was sent, which runs
  `speed` times as fast as the wall's; `states` and `events` are lists of `[topic, name, payload]`: the key
  pattern of the topic table (`users/{user}/cursor`), what stands for its placeholder (empty where there is
  none) and the message as on the bus, msgpack, itself bytes. `states` has of each key (latest and state
  topics) the newest only, and nil instead of a payload where the key's message is no longer true (its writer,
  person or scenario has gone): the page forgets it; `events` has every event in order, `dropped` counts those
  of this page that were lost because it was too slow. The first batch has the newest of everything that is
  still true; its events happened before the page came (at most `latest_values.HISTORY`, those of the
  selector's journal among them, see `history`), for its messages. States of a person may come before
  `Status.people` has them: it decides who is shown.

Page to server, JSON text, `{"kind": ...}`:

- `Ack` for every batch, once, from the animation frame that shows it. At most `IN_FLIGHT` batches are on
  their way; a page that does not acknowledge gets nothing more until it does, and then the newest. A second
  `Ack` of a batch is malformed.
- `Ask`, answered with the same `id`: a request of the table, or an action of this server (`Deed`).
  `Hello.requests` and `Hello.deeds` have those that the role may ask for; `Status.services` tells whether
  the server of a request is present.
- `AimAt`, many a second, not answered: where the mouse points to, of the person whose wrist this page has.
- `HeadsetMotion`, the same of a headset: head and hand of the person.

A page with a playback, at `/ws` of `pointit page` or at `/ws/past` of a running site, gets the
same, with the site's time and speed being those of the playback (speed 0: paused), and besides:

- `Timeline` first, and again when more of it is read; `Playing` when the page begins, and after each `Play`.
  With `Playing.has_jumped` what follows are differences to another instant, and no events from between.
- It sends `Play`, not answered. Its requests are refused.

A phone speaks `Turn` and `Ask` on `/ws/wrist`, or posts a list of them to `/wrist`; it is answered with
`Hello`, `Answer`s, and `Cue`s (see `phone`). It measures the round trip by an `Ask` for nothing, which is
refused at once. Its socket is closed with `UNPAIRED` or `REPLACED` where it is not to come back.
"""

import json
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr

from pointit.schemas import StepChoice
from pointit.schemas.base import Fraction, Name, QuaternionXyzw, Real, Vec3

Role = Literal["operator", "viewer", "wrist"]
"""Operator (control), viewer, or one person's phone."""

Mover = Literal["own", "mouse", "phone", "headset"]
"""Mover of a person's wrist: their own source, a page's mouse or headset, a phone."""

ArmSource = Literal["unknown", "none", "device", "simulation"]
"""Source of the movements of a person's arm while no page or phone has it. Unknown: not reported yet."""

Deed = Annotated[str, Field(max_length=64)]
"""Name of an action of this server: a row of `pages/arm_actions.py` or `pages/site_actions.py`,
which the schema for the client lists."""
Id = Annotated[int, Field(ge=0, le=2**53)]

LaneKind = Literal["interaction", "robot", "hover", "selections", "refusals", "wrong", "misses", "warnings"]
"""Content of a lane. `interaction`: states of the person; `robot`: what a robot does, and for whom; `wrong`:
selections of objects that are not wanted; `misses`: wanted objects that left without being selected."""

IN_FLIGHT = 3
"""Batches that a page may have been sent and not acknowledged."""

UNPAIRED = 4403
"""Close code: this phone is not paired any more."""
REPLACED = 4409
"""Close code: this phone has another socket."""

OWN_FAULT = "a fault of PointIt itself, see its log"
"""Answer to a request that failed by an error of this server."""

MAX_TOLD = 200
"""Maximum characters of a malformed message shown in health: it may be a page's own text."""
LATEST_MS = 9e12
"""Maximum of a device's clock: as many ns fit 64 bits."""


class WireModel(BaseModel):
    """Base of messages to and from pages."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)


class Hello(WireModel):
    """Greeting: the page's role and rights."""

    kind: Literal["hello"] = "hello"
    version: Annotated[str, Field(description="of PointIt")]
    site: str
    role: Role
    requests: Annotated[tuple[str, ...], Field(description="keys of the requests that this page may make")]
    deeds: tuple[Deed, ...]
    user: Annotated[str, Field(description="of a phone, or a page in its browser: whose wrist it is")] = ""
    lamps: Annotated[tuple[str, ...], Field(description="of a phone: lamps of the map")] = ()
    speaks: Annotated[
        bool, Field(description="names of things are spoken here, unless the person chose otherwise")
    ] = False
    language: Annotated[str, Field(description="of these names; the browser's if empty")] = ""
    home: Annotated[bool, Field(description="there is a home that this page may set up")] = False


class ServiceLine(WireModel):
    """A service that is, was or should be present."""

    instance: str
    present: bool
    since_s: Annotated[float, Field(description="time up or down, s of wall time")]


class FindingLine(WireModel):
    """A finding and its remedy."""

    severity: Literal["error", "warning", "note"]
    code: Annotated[str, Field(description="of `pointit doctor`, such as `silent`")]
    service: str
    sentence: str
    remedy: str
    follows: Annotated[bool, Field(description="from the outage of the whole site, a finding itself")] = False


class AssumedPlace(WireModel):
    """A person's assumed pose."""

    position_m: Annotated[Vec3, Field(description="of their feet in {W}, m")]
    yaw_rad: Annotated[float, Field(description="azimuth of {H}'s x axis in {W}, rad")]


class PersonLine(WireModel):
    """A person who is present."""

    user: str
    moved_by: Mover = "own"
    source: Annotated[ArmSource, Field(description="what moves the arm while it is `own`")] = "device"
    is_mine: Annotated[bool, Field(description="by this page")] = False
    phone: Annotated[str, Field(description="state of the paired phone; empty if none is paired")] = ""
    battery: Fraction | None = None
    assumed: Annotated[
        AssumedPlace | None, Field(description="until they have a pose; empty if none is configured")
    ] = None


class DeviceLine(WireModel):
    """A wrist or light that pages have connected."""

    id: str
    kind: Literal["wrist", "light"]
    name: Annotated[str, Field(description="of the person or strip")]
    plugin: Annotated[str, Field(description="name of its plug-in")]
    address: str
    label: Annotated[str, Field(description="model, name and the like")]
    pixels: Annotated[int, Field(ge=0, description="of a light; 0 if it does not say")] = 0
    is_on: Annotated[bool, Field(description="its process runs")]
    said: Annotated[str, Field(description="last line of the check of its mounting, while that runs")] = ""
    problem: Annotated[str, Field(description="reason why it does not work; empty if it does")] = ""


class Status(WireModel):
    """Status of the site beyond its topics."""

    kind: Literal["status"] = "status"
    services: tuple[ServiceLine, ...]
    findings: tuple[FindingLine, ...]
    people: tuple[PersonLine, ...]
    viewers: Annotated[int, Field(ge=0)]
    lan_url: Annotated[str, Field(description="address in the local network; empty if closed")] = ""
    devices: tuple[DeviceLine, ...] = ()
    run: Annotated[
        Literal["runs", "starts", "over"],
        Field(description="`starts`: services of another scenario are missing yet; `over`: ended on purpose"),
    ] = "runs"


class SharedReply(dict[str, Any]):
    """Fields of a reply that is the same for all pages, and their JSON text, serialized once."""

    def __init__(self, fields: Mapping[str, Any]) -> None:
        """Serialize `fields`, which do not change any more."""
        super().__init__(fields)
        self.text = _json_text(fields)


def _json_text(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"))


class Answer(WireModel):
    """Result of an `Ask`."""

    kind: Literal["answer"] = "answer"
    id: Id
    reply: Annotated[dict[str, Any] | None, Field(description="fields of the reply; empty if refused")] = None
    error: Annotated[str, Field(description="reason of the refusal; empty if done")] = ""
    is_stale: Annotated[
        bool, Field(description="refused, since the page knows an older state: it has to read it again")
    ] = False
    _reply_text: str = PrivateAttr(default="")
    """JSON text of a shared reply, or `""`."""

    @classmethod
    def of_reply(cls, number: int, reply: dict[str, Any]) -> Self:
        """Return the answer to the request `number`; a `SharedReply` is not serialized again."""
        answer = cls(id=number, reply=reply)
        if isinstance(reply, SharedReply):
            answer._reply_text = reply.text
        return answer

    def json_text(self) -> str:
        """Return it as JSON text."""
        if not self._reply_text:
            return _json_text(self.model_dump(mode="json"))
        fields = _json_text(self.model_dump(mode="json", exclude={"reply"}))
        return f'{fields[:-1]},"reply":{self._reply_text}}}'


class Cue(WireModel):
    """Cue for a phone's person: a `Feedback` of the bus, or the state of the interaction."""

    kind: Literal["cue"] = "cue"
    chime: str = ""
    haptic_ms: tuple[int, ...] = ()
    text: str = ""
    state: str = ""
    next_step: str = ""
    press: Annotated[str, Field(description="effect of a press now, as in `Interaction`; empty if none")] = ""
    wants_double: Annotated[bool, Field(description="a double press does what the next step asks for")] = (
        False
    )
    progress: Annotated[
        Fraction | None, Field(description="of pointing at targets; empty if there are none")
    ] = None
    announced: Annotated[str, Field(description="name of a thing to speak now; empty if there is none")] = ""
    has_names: Annotated[bool, Field(description="names of things are spoken to the person")] = False
    has_lost_arm: Annotated[bool, Field(description="the arm no longer follows this phone")] = False
    is_guided: Annotated[bool, Field(description="a set-up leads the person, as in `Interaction`")] = False
    choices: Annotated[
        tuple[StepChoice, ...], Field(description="of the next step, as in `Interaction`")
    ] = ()


class TimelineLane(WireModel):
    """One row of a timeline."""

    kind: LaneKind
    user: Annotated[str, Field(description="person or robot; empty if it is of the site")]
    items: Annotated[
        tuple[tuple[float, float, str], ...],
        Field(description="start and end, s from the beginning, equal for an instant; and a text"),
    ]


class Timeline(WireModel):
    """Contents of a page's playback."""

    kind: Literal["timeline"] = "timeline"
    title: Annotated[str, Field(description="name of the file, or empty for the past of a running site")] = ""
    began_ns: Annotated[int, Field(ge=0, description="site time of its beginning")]
    length_s: Annotated[float, Field(ge=0)]
    read_s: Annotated[float, Field(ge=0, description="lanes are complete, and seeks possible, until then")]
    problem: Annotated[str, Field(description="problem of the file, or empty")] = ""
    lanes: tuple[TimelineLane, ...]


class Playing(WireModel):
    """Position of a playback."""

    kind: Literal["playing"] = "playing"
    at_s: Annotated[float, Field(ge=0, description="from the beginning, now")]
    is_playing: bool
    speed: float
    has_jumped: Annotated[bool, Field(description="the position was set")] = False


class Play(WireModel):
    """Control of a page's playback. Fields that are missing do not change anything."""

    kind: Literal["play"] = "play"
    is_playing: bool | None = None
    speed: Annotated[float | None, Field(ge=0.25, le=8)] = None
    at_s: Annotated[float | None, Field(ge=0, le=1e9, description="where to go, from the beginning")] = None
    step: Annotated[Literal[-1, 0, 1], Field(description="to the message before or after, and pause")] = 0


class Ack(WireModel):
    """Acknowledgement that a batch was shown."""

    kind: Literal["ack"] = "ack"
    n: Id
    latency_ms: Annotated[
        float | None, Field(ge=0, le=1e7, description="from the capture at the wrist to this frame")
    ] = None


class Ask(WireModel):
    """Request of the table by its key pattern, or a deed of this server."""

    kind: Literal["ask"] = "ask"
    id: Id
    key: Annotated[str, Field(max_length=64, description="of the table of requests; empty for a deed")] = ""
    deed: Deed | None = None
    name: Annotated[str, Field(max_length=64, description="user or other placeholder of the key")] = ""
    query: Annotated[dict[str, Any], Field(description="fields of the query")] = {}


class AimAt(WireModel):
    """Point of the mouse, {W}."""

    kind: Literal["aim"] = "aim"
    user: Name
    at_m: Vec3


class SpaceAlignment(WireModel):
    """The space of a headset's session, z up, in {W}."""

    yaw_rad: Annotated[Real, Field(description="azimuth of its x axis")]
    origin_m: Vec3


class HeadsetMotion(WireModel):
    """Head and hand of a headset's wearer, in the space of its session, z up."""

    kind: Literal["headset"] = "headset"
    user: Name
    alignment: Annotated[
        SpaceAlignment | None, Field(description="empty before the alignment; then nothing moves")
    ] = None
    eyes_m: Vec3
    tip_m: Annotated[
        Vec3 | None, Field(description="tip of the hand or controller; empty if it is not tracked")
    ] = None


class Turn(WireModel):
    """The orientation of a phone."""

    kind: Literal["turn"] = "turn"
    q: QuaternionXyzw
    t_ms: Annotated[float, Field(ge=0, le=LATEST_MS, description="the phone's own clock")]
    session: Annotated[int, Field(ge=0, le=2**53)] = 0
    battery: Fraction | None = None


Received = Annotated[Ack | Ask | AimAt | Play | Turn | HeadsetMotion, Field(discriminator="kind")]
"""Messages that a page or phone may send."""

MODELS = (Hello, Status, Answer, Cue, Timeline, Playing, Ack, Ask, AimAt, Play, Turn, HeadsetMotion)
"""All of them but those of a scan, see `scan/wire.py`."""
