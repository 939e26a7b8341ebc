"""Requests of the request table as methods: `site.<first part of the key>.<last part>(...)`.

Each class serves `Site`, whose methods return awaitables, and `SyncSite`, whose methods wait. The type
parameter `D` is the return type for a `Done` reply, other parameters are those for other replies.
`tests/contract` compares all methods with the table.
"""

import re
from collections.abc import Callable, Sequence
from typing import Any, Generic, Literal, TypeVar

from pydantic import ValidationError

from pointit.geometry.rotation import Quaternion
from pointit.schemas import (
    LitPixels,
    PointingOffset,
    Query,
    RememberedBias,
    SchemaError,
    summarize_validation_error,
    topics,
)
from pointit.schemas.base import Rgb
from pointit.schemas.home import HomeAct, HomeChoice, HomeHand, HomePlace, HomeStep
from pointit.schemas.person import Deictic
from pointit.schemas.pointing import StepChoice
from pointit.schemas.topics import Request

D = TypeVar("D")
R = TypeVar("R")
S = TypeVar("S")
Vector = tuple[float, float, float]
SendQuery = Callable[[Request[Any, Any], Query, str], Any]
"""Sends a query, and returns what the method is to return."""

F = TypeVar("F")

HEX = re.compile(r"#[0-9a-fA-F]{6}")


def query_of(request: Request[Any, Any], fields: dict[str, Any]) -> Query:
    """Return the query of `request` with `fields`.

    Raises:
        SchemaError: If a value is wrong. Names the field, the value and the limit.
    """
    try:
        query: Query = request.query.model_validate(fields, strict=False)
    except ValidationError as error:
        raise SchemaError(f"{request.key}: {summarize_validation_error(error)}") from error
    return query


def as_sequence(names: str | Sequence[str]) -> Sequence[str]:
    """Return `names`, of which one alone may be given, as a sequence: a text is one of letters."""
    return [names] if isinstance(names, str) else names


def rgb_of(color: str | Rgb | None) -> Rgb | None:
    """Return red, green and blue of `color`, which may be written `#rrggbb`.

    Raises:
        SchemaError: If a text is no colour.
    """
    if not isinstance(color, str):
        return color
    if not HEX.fullmatch(color):
        raise SchemaError(f"{color!r} is no colour: write one like '#ff8800', or (255, 136, 0)")
    red, green, blue = bytes.fromhex(color[1:])
    return (red, green, blue)


class _Requests(Generic[D]):
    def __init__(self, send: SendQuery) -> None:
        self._send = send

    def _ask(self, request: Request[Any, Any], name: str = "", /, **fields: Any) -> Any:
        return self._send(request, query_of(request, fields), name)

    def _do(self, request: Request[Any, Any], name: str = "", /, **fields: Any) -> D:
        done: D = self._ask(request, name, **fields)
        return done


class SelectRequests(_Requests[D], Generic[D, R, S]):
    """Requests to the selector."""

    def clear(self, user: str) -> D:
        """Deselect everything that `user` has selected."""
        return self._do(topics.CLEAR_SELECTION, user)

    def undo(self, user: str) -> D:
        """Undo the last selection or deselection of `user`."""
        return self._do(topics.UNDO_SELECTION, user)

    def release(self, user: str, object_id: str, *, take_over: bool = False) -> D:
        """Deselect an object of any person, in the name of `user`; `take_over`: select it for `user`.

        On a secured site only operators and the supervisor may.
        """
        return self._do(topics.RELEASE_OBJECT, user, object_id=object_id, take_over=take_over)

    def set_thing(self, user: str, thing: str, *, on: bool | None = None, is_restored: bool = False) -> D:
        """Fire a thing of the map, or switch it, without pointing, as `user`. Nothing reacts if restored."""
        return self._do(topics.SET_THING, user, thing=thing, on=on, is_restored=is_restored)

    def method(self, name: str | None = None, *, dwell_s: float | None = None) -> R:
        """Set how dwelling selects, and for how long (s). Without values, only return the settings in use.

        `name`: `hold`, `fraction`, `gauge` or any other installed method. It has its own time unless given.
        """
        reply: R = self._ask(topics.SET_METHOD, name=name, dwell_s=dwell_s)
        return reply

    def history(self, *, last: int = 200, since_ns: int = 0) -> S:
        """Return the last selection events from the journal, none before `since_ns`."""
        reply: S = self._ask(topics.READ_HISTORY, last=last, since_ns=since_ns)
        return reply


class ConveyorRequests(_Requests[D], Generic[D, R]):
    """Requests to the conveyor."""

    def add_package(
        self, kind: str, *, lane: str = "", length_m: float = 0.3, position: float | None = None
    ) -> R:
        """Put an object on a lane, at `position` (0 to 1 of its length) or at the feed point."""
        reply: R = self._ask(topics.ADD_PACKAGE, kind=kind, lane=lane, length_m=length_m, position=position)
        return reply

    def set_speed(self, speed_mps: float, *, belts: str | Sequence[str] = ()) -> D:
        """Set the speed of all belts, or of `belts`, m/s. 0 stops them, below 0 they run backwards."""
        return self._do(topics.SET_SPEED, speed_mps=speed_mps, belts=as_sequence(belts))

    def set_feeding(self, feeding: bool) -> D:
        """Start or stop the feeders."""
        return self._do(topics.SET_FEEDING, feeding=feeding)

    def reset(self) -> D:
        """Remove all objects and start the feeders again."""
        return self._do(topics.RESET_CONVEYOR)


class LocalizerRequests(_Requests[D]):
    """Requests to a person's localizer."""

    def start(self, user: str, method: Literal["static_targets", "moving_target"] | None = None) -> D:
        """Begin to localize `user`, by the configured method unless one is given."""
        return self._do(topics.START_LOCALIZATION, user, method=method)

    def cancel(self, user: str, *, forget_bias: bool = False) -> D:
        """Stop localizing and keep the last pose; `forget_bias`: forget the elevation bias of `user`, too."""
        return self._do(topics.CANCEL_LOCALIZATION, user, forget_bias=forget_bias)

    def set_pose(
        self,
        user: str,
        position_m: Vector,
        *,
        yaw_rad: float = 0.0,
        method: Literal["fixed", "static_targets", "moving_target"] = "fixed",
        covariance: Sequence[float] | None = None,
        elevation_bias_rad: float = 0.0,
        remembered_bias: RememberedBias | None = None,
    ) -> D:
        """Set the pose of `user`; `covariance` of (x, y, yaw), row by row, if it is not exact."""
        return self._do(
            topics.SET_POSE,
            user,
            position_m=position_m,
            yaw_rad=yaw_rad,
            method=method,
            covariance=covariance,
            elevation_bias_rad=elevation_bias_rad,
            remembered_bias=remembered_bias,
        )

    def set_heading(self, user: str, azimuth_rad: float) -> D:
        """Set the yaw of `user`, who points in the direction `azimuth_rad` of {W} now."""
        return self._do(topics.SET_HEADING, user, azimuth_rad=azimuth_rad)

    def point_anchor(self, user: str, lamp: str = "") -> D:
        """Ask `user` to point at one lamp without a cursor, to correct the pose; `""`: the best one."""
        return self._do(topics.POINT_ANCHOR, user, lamp=lamp)


class ProfileRequests(_Requests[D]):
    """Requests about a person's profile."""

    def set_offset(self, user: str, offset: PointingOffset | None = None) -> D:
        """Keep the pointing offset of `user`, or remove it."""
        return self._do(topics.SET_OFFSET, user, offset=offset)


class PuiRequests(_Requests[D], Generic[D, R, S]):
    """Requests to the service that computes cursors."""

    def set_workspace(
        self,
        user: str,
        kind: Literal["none", "horizontal", "facing", "cylinder", "sphere"],
        *,
        anchor: Literal["pointer", "object", "point"] = "pointer",
        object_id: str = "",
        point_m: Vector | None = None,
    ) -> D:
        """Move the cursor of `user` to a surface around them, through `anchor`. `none`: to the map."""
        return self._do(
            topics.SET_WORKSPACE, user, kind=kind, anchor=anchor, object_id=object_id, point_m=point_m
        )

    def tolerance(self, tolerance_rad: float | None = None) -> R:
        """Set how far a ray may pass its target. Without a value, only return the tolerance in use."""
        reply: R = self._ask(topics.SET_TOLERANCE, tolerance_rad=tolerance_rad)
        return reply

    def map(self, path: str = "") -> S:
        """Use another map, a shipped one or a path on pui's machine. Without one, only return its name."""
        reply: S = self._ask(topics.USE_MAP, path=path)
        return reply


class RobotsRequests(_Requests[D]):
    """Requests to robots."""

    def stop(self, robot: str, reason: str = "") -> D:
        """Stop `robot`; nobody steers it until somebody takes it again. `reason`: why, in a few words."""
        return self._do(topics.STOP_ROBOT, robot, reason=reason)


class ListenerRequests(_Requests[D], Generic[D, R]):
    """Requests about what a person means by words."""

    def referents(
        self,
        user: str,
        at_ns: int | None = None,
        within_s: float = 1.0,
        *,
        word: Deictic = "",
        others_ns: tuple[int, ...] = (),
    ) -> R:
        """Return the candidates for a word that `user` spoke at `at_ns`, the most probable first.

        Args:
            user: who spoke. Their service `listener` keeps their last ten seconds.
            at_ns: middle of the word, Unix ns of the site's time. None: now.
            within_s: maximum time between the word and a ray that counts, s. Later rays are missing if they
                have not arrived yet.
            word: that was spoken, `""` for any.
            others_ns: middles of the other deictic words of the sentence.
        """
        reply: R = self._ask(
            topics.FIND_REFERENTS, user, at_ns=at_ns, within_s=within_s, word=word, others_ns=others_ns
        )
        return reply


class GoalRequests(_Requests[D]):
    """Requests to a person's service that sends robots."""

    def send(self, user: str, position_m: Vector, *, robot: str = "") -> D:
        """Send `robot` to a place of the floor in the name of `user`, with the checks of a place pointed at.

        `robot`: `""` is the one that they have, or any where robots are not taken by pointing.
        """
        return self._do(topics.SEND_ROBOT, user, robot=robot, position_m=position_m)


class RunRequests(_Requests[D]):
    """Requests to the run that started the site."""

    def scenario(self, scenario: str, *, users: int | None = None, localizes: bool | None = None) -> D:
        """Replace the running scenario by another, with as many people and as localized unless given."""
        return self._do(topics.RUN_SCENARIO, scenario=scenario, users=users, localizes=localizes)


class LedsRequests(_Requests[D]):
    """Requests to the LED driver."""

    def brightness(self, brightness: float, *, strips: str | Sequence[str] = ()) -> D:
        """Dim all strips, or `strips`, to `brightness`, 0 to 1."""
        return self._do(topics.SET_BRIGHTNESS, brightness=brightness, strips=as_sequence(strips))

    def show(self, lit: tuple[LitPixels, ...] = (), *, for_s: float = 5.0) -> D:
        """Show only the pixels `lit` for a while, undimmed. `for_s` 0 ends it."""
        return self._do(topics.SHOW_PIXELS, lit=lit, for_s=for_s)

    def set_color(self, lamp: str, color: str | Rgb | None = None) -> D:
        """Show `color` on `lamp`: `#rrggbb` or (red, green, blue). None gives it back to the site."""
        return self._do(topics.SET_LAMP, lamp, color=rgb_of(color))


class ImuRequests(_Requests[D], Generic[D, R]):
    """Requests to a person's IMU."""

    def set_yaw_origin(self, user: str, yaw_rad: float = 0.0) -> D:
        """Turn the IMU of `user` so that it reads `yaw_rad` now."""
        return self._do(topics.SET_YAW_ORIGIN, user, yaw_rad=yaw_rad)

    def set_mounting(
        self, user: str, sensor_from_arm_xyzw: Quaternion | None = None, *, is_relative: bool = False
    ) -> R:
        """Set the mounting of the sensor on the arm, as a rotation of arm vectors into the sensor."""
        reply: R = self._ask(
            topics.SET_MOUNTING, user, sensor_from_arm_xyzw=sensor_from_arm_xyzw, is_relative=is_relative
        )
        return reply


class FeedbackRequests(_Requests[D]):
    """Requests for feedback to a person."""

    def say(
        self,
        user: str,
        text: str,
        *,
        stays: bool = False,
        service: str = "",
        is_over: bool = False,
        guides: bool = False,
        choices: Sequence[StepChoice] = (),
    ) -> D:
        """Show `text`, at most 200 characters, on the page and phone of `user`, with a chime.

        With `stays` there is no chime: it is their next step while they point, until another one, or until
        the same text with `is_over`; with the instance name of a `service`, also until that ends. With
        `guides` besides, it is their next step also while they rest, before that of any other service, and
        `choices` are shown with it.
        """
        fields = {"stays": stays, "service": service, "is_over": is_over, "guides": guides}
        return self._do(topics.SAY, user, text=text, choices=choices, **fields)


class HomeRequests(_Requests[D], Generic[D, R]):
    """Requests to the set-up of a home."""

    def set_up(  # noqa: PLR0917 - the fields of the query in their order
        self,
        act: HomeAct = "read",
        url: str = "",
        lamps: Sequence[str] = (),
        hand: HomeHand = "",
        user: str = "",
        place: HomePlace = "",
        step: HomeStep | None = None,
        secret: str = "",
        choice: HomeChoice = "",
    ) -> R:
        """Do one act at the cards of `pointit home`, and return what they show. For operators only."""
        fields = {"url": url, "lamps": lamps, "hand": hand, "user": user, "place": place, "step": step}
        reply: R = self._ask(topics.SET_UP_HOME, act=act, secret=secret, choice=choice, **fields)
        return reply


class Lamp(Generic[D, F]):
    """One lamp of the map: the colour it shows, and a colour for it.

    People who localize go first: while they use lamps, all others are dark, and then have their colour again.
    """

    def __init__(self, name: str, leds: LedsRequests[D], colors: Callable[[str], F]) -> None:
        self.name = name
        self._leds = leds
        self._colors = colors

    def set(self, color: str | Rgb | None) -> D:
        """Show `color`: `#rrggbb` or (red, green, blue). None gives the lamp back to the site.

        Raises:
            RefusedError: If there is no such lamp.
            AccessDeniedError: If this identity may not ask for it.
        """
        return self._leds.set_color(self.name, color)

    def colors(self) -> F:
        """Return an iterator over the `LampColor` it shows: the present one at once, then each change."""
        return self._colors(self.name)
