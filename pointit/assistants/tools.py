"""Tools of an assistant: each asks the site, with the rights of its caller, and is in the audit."""

import asyncio
import contextlib
import datetime as dt
import inspect
import math
from collections import Counter
from collections.abc import Awaitable, Callable, Collection, Generator
from typing import Annotated, Any, Literal

from mcp.server.mcpserver import Context
from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field

from pointit.api.feed import Feed
from pointit.api.site import Site
from pointit.assistants.audit_file import AuditFile
from pointit.assistants.light import ASKING, COLORS, Lights, color_of
from pointit.assistants.results import (
    MAX_SENTENCE,
    ActionResult,
    AnswerByLight,
    Items,
    PossibleReferent,
    PossibleReferents,
    PresentPeople,
    Waited,
    check_present,
    current,
    find,
    items,
    people,
    plain,
    present,
    refusal,
)
from pointit.assistants.site_connection import SiteConnection
from pointit.errors import AccessDeniedError, NoAnswerError, PointItError, SchemaError
from pointit.schemas import NS_PER_S, RobotState
from pointit.schemas.base import FARTHEST, Vec3
from pointit.schemas.person import Deictic
from pointit.schemas.text import hide_secrets
from pointit.schemas.topics import ROBOT_STATE

Role = Literal["operator", "viewer"]
"""Role of a caller, by the token of its request, or over stdio by the command's option."""
Ctx = Context[Any, Any]
User = Annotated[str, Field(max_length=64, description="name of a person who is present")]
Name = Annotated[str, Field(min_length=1, max_length=256, description="name or label, as `things` lists it")]
Metre = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST)]

MAX_CANDIDATES = 8
LOOK_S = 0.2
"""Time between two looks while waiting, s."""
SURE = 0.6
"""Least probability of what is waited for."""
ITEMS = ("thing", "robot", "object", "person")
"""Kinds of referents that have a name of their own."""
SCOPE_KEY = "pointit.role"
"""Key of an HTTP request's scope that holds the role of its token."""
MAX_WAIT_S = 120.0

Seconds = Annotated[float, Field(ge=0, le=MAX_WAIT_S)]

MAX_CALLS = 16
"""Limit of simultaneous calls of one tool by one role. Those that wait ask the listener 5 times a second."""
SET_OFF_S = 4.0
"""Time within which a robot that was sent sets off, s."""
OLD_S = 1.0
"""Time after which the reason of a robot that obeys the person is no earlier one, s."""
NEAR_M = 0.3
"""Distance within which a robot's target is the place where it was sent, m."""


async def pointed(site: Site, user: str, at_ns: int | None, word: Deictic = "") -> PossibleReferents:
    """Return the candidates for what `user` pointed at, at `at_ns` of the site's time, or now.

    Raises:
        PointItError: If they are not there, nobody keeps where they point, or that time is not kept.
    """
    await check_present(site, user)
    try:
        referents = await site.listener.referents(user, at_ns, word=word)

    # Without an answer: which service is missing, or why it is silent
    except NoAnswerError as error:
        if isinstance(error, AccessDeniedError) or site.problem:  # a lost site has no services
            raise
        if f"listener.{user}" in await current(site.services()):
            raise NoAnswerError(
                f"listener.{user} runs, but does not answer in time: its machine is busy, or it is stopped; "
                "ask again, or see `pointit doctor`"
            ) from error
        raise NoAnswerError(
            f"nobody keeps where {user} points: run `pointit service run listener --user {user}`"
        ) from error
    ago_s = 0.0 if at_ns is None else (site.now_ns() - at_ns) / NS_PER_S
    candidates: list[PossibleReferent] = []
    for candidate in referents.candidates[:MAX_CANDIDATES]:
        candidates.append(
            PossibleReferent(
                kind=candidate.kind,
                name=plain(candidate.name),
                probability=round(candidate.probability, 3),
                position_m=candidate.place_m,
            )
        )
    return PossibleReferents(
        user=user,
        seconds_ago=round(ago_s, 2),
        candidates=tuple(candidates),
        none=round(referents.none, 3),
        note=plain(referents.message, MAX_SENTENCE),
    )


async def wait_for(site: Site, user: str, names: Collection[str], timeout_s: float) -> Waited:
    """Wait until `user` points at one of `names`, or at anything that has a name if there are none.

    Raises:
        PointItError: If they are not there, or nobody keeps where they point.
    """
    last = await pointed(site, user, None)
    previous_name = ""
    looked_ns = 0
    feed = site.cursors(user)
    try:
        async for cursor in feed.during(timeout_s):
            if cursor.stamp_ns - looked_ns < LOOK_S * NS_PER_S:
                continue
            looked_ns = cursor.stamp_ns
            last = await pointed(site, user, None)
            name = _sure_of(last, names)
            if name and name == previous_name:  # two looks, so that a hand that passes by does not count
                return Waited(came=True, pointed=last)
            previous_name = name
    finally:
        feed.close()
    return Waited(came=False, pointed=last)


def _sure_of(seen: PossibleReferents, names: Collection[str]) -> str:
    """Return the name of what is pointed at, if it is surely one of `names`, else `""`."""
    if not seen.candidates:
        return ""
    best = seen.candidates[0]
    is_wanted = best.name in names if names else best.kind in ITEMS
    if not is_wanted or best.probability < SURE:
        return ""
    return best.name


class Tools:
    """The tools. Their docstrings are what an assistant reads."""

    def __init__(
        self, connection: SiteConnection, audit: AuditFile, max_role: Role, *, is_remote: bool = False
    ) -> None:
        """Use the site of `connection`. `max_role`: highest role. `is_remote`: only by a token."""
        self._connection = connection
        self._audit = audit
        self._max_role: Role = max_role
        self._unknown: Role = "viewer" if is_remote else max_role
        self._lights = Lights()
        self._calls: Counter[tuple[str, Role]] = Counter()
        """Running calls by tool and role."""

    def guarded(self, tool: Callable[..., Awaitable[Any]], *, needs: Role) -> Callable[..., Awaitable[Any]]:
        """Return `tool` for the server: called with the site, for the role `needs` only, and audited.

        The first parameter of `tool` is the site. Operators may all that viewers may.
        """

        async def called(ctx: Ctx, **asked: Any) -> Any:
            role = self.role_of(ctx)
            try:
                name = tool.__name__
                with self.recorded(caller_of(ctx), role, name, asked), self._count_call(name, role):
                    if role not in (needs, "operator"):
                        raise AccessDeniedError(f"{name} needs the operator's token, this is a viewer's")
                    return await tool(self.site, **asked)
            except PointItError as error:
                raise ToolError(refusal(str(error))) from error

        # The library reads name, help and parameters of a tool from the function: the site is none of them
        signature = inspect.signature(tool)
        context = inspect.Parameter("ctx", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=Ctx)
        _site, *own_parameters = signature.parameters.values()
        parameters = [context, *own_parameters]
        called.__name__ = tool.__name__
        called.__doc__ = tool.__doc__
        called.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        vars(called)["__signature__"] = signature.replace(parameters=parameters)
        return called

    @property
    def site(self) -> Site:
        """The site. Raises ConnectError if it is not reachable now."""
        return self._connection.site

    @contextlib.contextmanager
    def recorded(self, caller: str, role: str, what: str, asked: dict[str, Any]) -> Generator[None]:
        """Record in the audit that the block is begun, and how it ends.

        Raises:
            PointItError: If that cannot be written, before the block.
        """
        call = self._audit.begin(caller, role, what, asked)
        outcome = "failed"
        text = ""
        try:
            yield
            outcome = "done"
        except PointItError as error:
            outcome = "refused"
            text = hide_secrets(str(error))
            raise
        except asyncio.CancelledError:
            outcome = "cancelled"
            raise
        finally:
            self._audit.end(call, outcome, text)

    @contextlib.contextmanager
    def _count_call(self, tool: str, role: Role) -> Generator[None]:
        """Count a call while the block runs. Raises PointItError if too many run."""
        if self._calls[tool, role] >= MAX_CALLS:
            raise PointItError(f"{MAX_CALLS} calls of {tool} run, the limit: wait until one has ended")
        self._calls[tool, role] += 1
        try:
            yield
        finally:
            self._calls[tool, role] -= 1

    def role_of(self, context: Ctx) -> Role:
        """Return the role of the caller of this request."""
        request = context.request_context.request
        role: Role = self._unknown if request is None else request.scope[SCOPE_KEY]
        return role if self._max_role == "operator" else "viewer"

    async def who_is_here(self, site: Site) -> PresentPeople:
        """List the people who are present, where they stand, and whether they point."""
        return await people(site)

    async def things(self, site: Site) -> Items:
        """List what has a name in the room: things, lamps, robots, tracked objects. Positions are in m."""
        return await items(site)

    async def what_is_pointed_at(
        self,
        site: Site,
        user: User,
        seconds_ago: Annotated[float, Field(ge=0, le=30, description="0: now")] = 0.0,
        word_time: Annotated[
            str,
            Field(
                max_length=40,
                description="instead: when a word such as 'that' was spoken, ISO 8601 with zone",
            ),
        ] = "",
        word: Annotated[Deictic, Field(description="the word itself, or empty for any")] = "",
    ) -> PossibleReferents:
        """Say what a person means by pointing: candidates with probabilities, and that of none of them.

        If the best one is below 0.8, ask the person, or use `ask_by_light`. Do not guess.
        """
        at_ns = None
        if word_time:
            at_ns = ns_of(word_time)
        elif seconds_ago:
            at_ns = site.now_ns() - round(seconds_ago * NS_PER_S)
        return await pointed(site, user, at_ns, word)

    async def wait_for_pointing(
        self,
        site: Site,
        user: User,
        what: Annotated[
            tuple[Name, ...], Field(max_length=32, description="names; anything that has one if empty")
        ] = (),
        timeout: Seconds = 20.0,  # noqa: ASYNC109 - time on the site, a parameter of the protocol
    ) -> Waited:
        """Wait until a person points at one of some things, or at anything that has a name."""
        names = [(await find(site, name)).name for name in what]
        waited = await wait_for(site, user, names, timeout)
        if not waited.came:
            _ = self.site  # says that the site was lost meanwhile
        return waited

    async def light(
        self,
        site: Site,
        thing: Name,
        colour: Annotated[str, Field(max_length=20, description=f"#rrggbb, off, {', '.join(COLORS)}")],
    ) -> ActionResult:
        """Light the lamp of a thing, or a lamp, until it is set to `off`, which gives it back to the site."""
        color = color_of(colour)
        item = await find(site, thing)
        message = await self._lights.show(site, item, color)
        return ActionResult(message=message)

    async def ask_by_light(
        self,
        site: Site,
        user: User,
        candidates: Annotated[tuple[Name, ...], Field(min_length=2, max_length=len(ASKING))],
        timeout: Seconds = 20.0,  # noqa: ASYNC109 - as above
    ) -> AnswerByLight:
        """Light candidates in turn, each in its colour, until the person presses their button for one.

        While it waits, the person may also be asked in words for the colour.
        """
        candidate_items = [await find(site, name) for name in candidates]
        return await self._lights.ask(site, user, candidate_items, timeout)

    async def send_robot(
        self,
        site: Site,
        robot: Name,
        user: Annotated[str, Field(max_length=64, description="in whose name: who wants it, and points")],
        thing: Annotated[str, Field(max_length=256, description="go to the floor at this thing")] = "",
        place: Annotated[
            tuple[Metre, Metre, Metre] | None, Field(description="or to this place, x y z in m")
        ] = None,
    ) -> ActionResult:
        """Send a robot to a thing or a place, in the name of a person who points.

        The robot's own checks hold: fences, people near the place, a person who is sure of their direction.
        It may refuse, with a reason. It moves in the real room.
        """
        if bool(thing) == (place is not None):
            raise PointItError("name a thing or a place, one of them")
        await check_present(site, user)
        robot_item = await find(site, robot, "robot")
        if robot_item.position_m is None:
            raise PointItError(f"nobody knows where robot {robot_item.name!r} is")

        # A thing is on the floor or above: the robot keeps its own height
        goal_m = place
        if goal_m is None:
            target = await find(site, thing)
            if target.position_m is None:
                raise PointItError(f"nobody knows where {target.kind} {target.name!r} is")
            x_m, y_m, _ = target.position_m
            goal_m = (x_m, y_m, robot_item.position_m[2])

        # Its states are received before it is sent, so that none of its answers is missed
        states = site.messages(ROBOT_STATE, robot_item.name)
        try:
            await site.goal.send(user, goal_m, robot=robot_item.name)
            message = await set_off(states, robot_item.name, user, goal_m)
            return ActionResult(message=message)
        finally:
            states.close()

    async def stop_robot(
        self, site: Site, robot: Name, reason: Annotated[str, Field(max_length=200)] = ""
    ) -> ActionResult:
        """Stop a robot where it is. Nobody steers it until somebody takes it again. No safety function."""
        reply = await site.robots.stop(robot, reason)
        return ActionResult(message=reply.message)

    async def say(
        self,
        site: Site,
        text: Annotated[str, Field(min_length=1, max_length=200)],
        user: Annotated[
            str, Field(max_length=64, description="to whom; to all who are present if empty")
        ] = "",
    ) -> ActionResult:
        """Show a text to a person on their page and phone, with a chime."""
        listeners = [user] if user else sorted(await present(site))
        for listener in listeners:
            await check_present(site, listener)
            await site.feedback.say(listener, text)
        names = ", ".join(listeners) or "nobody"
        return ActionResult(message=f"told {names}")


async def set_off(states: Feed[RobotState], robot: str, user: str, goal_m: Vec3) -> str:
    """Return that `robot` is on its way to `goal_m` for `user`, once it is, or is there.

    Raises:
        PointItError: If it is not in time. Gives the robot's reason.
    """
    reason = "it does not answer"
    first_ns = 0
    async for state in states.during(SET_OFF_S):
        first_ns = first_ns or state.stamp_ns

        # It does not obey the person, or not yet
        if state.user != user:
            if state.user and not state.reason:
                reason = f"{state.user} steers it"
            reason = state.reason or reason
            continue
        target_m = state.target_m or state.position_m
        if math.dist(target_m[:2], goal_m[:2]) < NEAR_M:
            return f"{robot} is on its way"

        # Its reason may still be that of an earlier refusal
        reason = state.reason or reason
        if state.reason and state.stamp_ns - first_ns > OLD_S * NS_PER_S:
            break
    raise PointItError(f"{robot} does not set off: {reason}")


def caller_of(context: Ctx) -> str:
    """Return the name and version that the client gives itself."""
    parameters = context.session.client_params
    if parameters is None:
        return ""
    client = parameters.client_info
    return f"{client.name} {client.version}"


def ns_of(text: str) -> int:
    """Return a time in ISO 8601 as Unix ns.

    Raises:
        SchemaError: If it is none, or has no zone.
    """
    problem = f"word_time {text!r}: write one such as 2026-03-01T14:30:05.250+01:00"
    try:
        time = dt.datetime.fromisoformat(text)
    except ValueError:
        raise SchemaError(problem) from None
    if time.tzinfo is None:
        raise SchemaError(problem)
    unix_s = time.timestamp()
    if not 0 <= unix_s < 2**63 / NS_PER_S:
        raise SchemaError(problem)
    return round(unix_s * 1e6) * 1000  # a date has µs
