"""Reactions of `pointit run --on`: programs and requests to web servers, when people point at things."""

import asyncio
import contextlib
import importlib.util
import json
import logging
import os
import re
import shlex
import shutil
import signal
from collections import deque
from collections.abc import Coroutine, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, cast
from urllib.parse import quote, urlsplit

from pointit.api.feed import check_things, is_reaction
from pointit.launch.plan.plan import OnEvent
from pointit.runtime.address_config import parse_address
from pointit.runtime.bus.contract import Bus, Closable
from pointit.runtime.config.nearest_name import nearest
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.certificate_errors import certificate_error_in, describe_certificate_error
from pointit.runtime.host.extras import pointit_version, remedy
from pointit.schemas import Environment, SelectionEvent
from pointit.schemas.text import hide_secrets, one_line
from pointit.schemas.topics import SELECTION_EVENTS

if TYPE_CHECKING:
    import httpx


MAX_S = 60.0
"""Time after which a program is ended, s."""
GRACE_S = 1.0
"""Time from SIGTERM to SIGKILL, s."""
PLACEHOLDER = re.compile(r"\{(\w+)\}")
PLACEHOLDERS = ("thing", "user", "confidence", "state")


def check_placeholders(text: str) -> None:
    """Check that all placeholders in `text` are known. Raises ConfigError."""
    for name in PLACEHOLDER.findall(text):
        if name not in PLACEHOLDERS:
            raise ConfigError(f"there is no {{{name}}}; {nearest(name, PLACEHOLDERS)}")


def filled(text: str, values: Mapping[str, str]) -> str:
    """Return `text` with the values of its placeholders, which are those of `PLACEHOLDERS`."""
    return PLACEHOLDER.sub(lambda match: values[match[1]], text)


@dataclass(frozen=True, kw_only=True)
class Program:
    """A program with its arguments, in which there are placeholders."""

    arguments: Sequence[str]
    is_shown: bool = False
    """Its output goes to that of this process."""
    interruption: ClassVar[str] = ""
    """A program that ends with the run has not failed."""

    @classmethod
    def parse(cls, line: str) -> Self:
        """Return the program in `line`, which is quoted as in a shell.

        Raises:
            ConfigError: If it is none, has an unknown placeholder, or there is no such program.
        """
        try:
            arguments = shlex.split(line)
        except ValueError as error:
            raise ConfigError(f"{str(error).lower()}; close it") from error
        check_placeholders(line)
        if not PLACEHOLDER.search(program := arguments[0]) and shutil.which(program) is None:
            raise ConfigError(f"no program {program}; give a path, and `chmod +x` a script")
        return cls(arguments=arguments)

    def describe(self, values: Mapping[str, str]) -> str:
        """Return its words, with the values of placeholders."""
        return shlex.join(filled(argument, values) for argument in self.arguments)

    async def react(self, values: Mapping[str, str]) -> str:
        """Run it, and end all that it has started. Return what went wrong, or `""`."""
        nothing = asyncio.subprocess.DEVNULL
        output = None if self.is_shown else nothing
        arguments = [filled(argument, values) for argument in self.arguments]
        try:
            program = await asyncio.create_subprocess_exec(
                *arguments, stdin=nothing, stdout=output, stderr=output, start_new_session=True
            )
        except OSError as error:
            return f"could not be started ({error.strerror or error})"
        try:
            async with asyncio.timeout(MAX_S):
                code = await program.wait()
        except TimeoutError:
            return f"was ended after {MAX_S:g} s"
        finally:
            await _end_group(program.pid)
        if not code:
            return ""
        return f"ended with {f'exit code {code}' if code > 0 else f'signal {-code}'}"


async def _end_group(group: int) -> None:
    """End what is left of a process group, at once if this is cancelled."""
    try:
        os.killpg(group, signal.SIGTERM)
        await asyncio.sleep(GRACE_S)
    except OSError:  # nothing is left, or it belongs to another user
        return
    finally:
        with contextlib.suppress(OSError):
            os.killpg(group, signal.SIGKILL)


TIMEOUT_S = 5.0
"""Maximum time of a try, s."""
PAUSES_S = (1.0, 4.0)
"""Pauses before the second and the third try, s."""
AUTHORITY_HINT = "set the variable SSL_CERT_FILE to a file with its authority's certificate"
MAX_REASON = 200
"""Characters of a server's words that are shown."""
SUCCESS, REDIRECT = 200, 300
TOO_MANY_REQUESTS = 429
SERVER_ERROR = 500


@dataclass(frozen=True, kw_only=True)
class Webhook:
    """A URL that gets a request with a JSON object: `thing`, `user`, `state`, `confidence`, `stamp_ns`."""

    url: str
    interruption: ClassVar[str] = "had not answered when the run ended"

    @classmethod
    def parse(cls, url: str) -> Self:
        """Return the webhook with this URL, in which there may be placeholders.

        Raises:
            ConfigError: If it has no host, an unknown placeholder, or the extra is missing.
        """
        try:
            parts = urlsplit(url)
            host, _port = parts.hostname, parts.port
            if host:
                parse_address(parts.netloc.rpartition("@")[2])
        except ValueError as error:
            # an unquoted / in a password ends the host, and the error has the rest of it
            raise ConfigError(
                f"{hide_secrets(url)} is no URL: write http://HOST:PORT/PATH, with %2F for / in a password"
            ) from error
        if not host:
            raise ConfigError(f"{hide_secrets(url)} has no host; write http://HOST/PATH")
        check_placeholders(url)
        if importlib.util.find_spec("httpx") is None:
            raise ConfigError(f"webhooks need an extra: run {remedy('webhooks')}")
        return cls(url=url)

    def describe(self, _values: Mapping[str, str]) -> str:
        """Return its scheme and host: what follows them is often a secret."""
        return hide_secrets(urlsplit(self.url)._replace(path="/...", query="", fragment="").geturl())

    async def react(self, values: Mapping[str, str]) -> str:
        """Send it, up to three times, always with the same key. Return what went wrong, or `""`."""
        import httpcore  # noqa: PLC0415 - of an extra
        import httpx  # noqa: PLC0415 - an extra

        from pointit.cli.things.http_status import open_pool, post  # noqa: PLC0415 - as above

        try:
            request = self._request(values)
        except (httpx.InvalidURL, UnicodeError) as error:
            return f"was not sent, as its address is not valid ({error}): correct it"
        problem = ""
        for pause_s in (0.0, *PAUSES_S):
            await asyncio.sleep(pause_s)
            try:
                async with asyncio.timeout(TIMEOUT_S):
                    try:
                        pool = await asyncio.to_thread(open_pool, request.url)
                    except (ValueError, ImportError, httpx.InvalidURL) as error:
                        return (
                            f"cannot be reached by the proxy that this environment names ({error}): correct "
                            "all_proxy, http_proxy and https_proxy, or name its host in no_proxy"
                        )
                    except OSError as error:
                        return (
                            f"was not sent, as the file of SSL_CERT_FILE cannot be used ({error}): correct it"
                        )
                    async with pool:
                        status, reason = await post(pool, request)
            except (TimeoutError, httpcore.TimeoutException):
                problem = f"did not answer within {TIMEOUT_S:g} s"
            # UnicodeError: no name of a host, such as with a label of more than 63 characters
            except (
                httpcore.NetworkError,
                httpcore.ProtocolError,
                httpcore.ProxyError,
                UnicodeError,
            ) as error:
                problem = f"could not be reached ({_cause(error)})"
            else:
                if SUCCESS <= status < REDIRECT:
                    return ""
                problem = f"answered {status} {one_line(reason, MAX_REASON)}".rstrip()
                if status < SERVER_ERROR and status != TOO_MANY_REQUESTS:
                    return problem
        return f"{problem}, {1 + len(PAUSES_S)} times"

    def _request(self, values: Mapping[str, str]) -> "httpx.Request":
        """Return the request with `values` of placeholders, always the same one for the same event.

        Raises:
            httpx.InvalidURL: If the values of placeholders make no host.
        """
        import httpx  # noqa: PLC0415 - an extra

        url = httpx.URL(filled(self.url, {name: quote(value, safe="") for name, value in values.items()}))
        confidence, stamp = values["confidence"], values["stamp_ns"]
        body = {
            **{name: values[name] for name in ("thing", "user", "state")},
            "confidence": float(confidence) if confidence else None,
            "stamp_ns": int(stamp),
        }
        headers = {
            "Accept-Encoding": "identity",
            "Connection": "close",
            "Content-Type": "application/json",
            "Idempotency-Key": quote(f"{values['thing']}-{values['user']}-{stamp}"),
            "User-Agent": f"PointIt/{pointit_version()}",
        }
        request = httpx.Request("POST", url, headers=headers, content=json.dumps(body))
        if url.username or url.password:
            next(httpx.BasicAuth(url.username, url.password).auth_flow(request))
        return request


def _cause(error: Exception) -> str:
    """Return the reason of an error of a connection, and the remedy for one of a certificate."""
    refusal = certificate_error_in(error)
    if refusal is not None:
        return describe_certificate_error(refusal, "the server", AUTHORITY_HINT)
    return one_line(str(error), MAX_REASON) or type(error).__name__


log = logging.getLogger(__name__)

MAX_AT_ONCE = 8
"""Maximum number of reactions at a time. Further ones are dropped."""
MAX_FAILURES = 20
"""Number of last failures in the summary. Earlier ones are only counted."""
FILES = (".yaml", ".yml")


class ReactionTarget(Protocol):
    """Program or webhook."""

    interruption: ClassVar[str]
    """Problem if the end of the run interrupts it, or `""`."""

    def describe(self, values: Mapping[str, str], /) -> str:
        """Return a description for logs."""
        ...

    def react(self, values: Mapping[str, str], /) -> Coroutine[Any, Any, str]:
        """Do it. Return what went wrong, or `""`. `values`: those of placeholders, and `stamp_ns`."""
        ...


@dataclass(frozen=True, kw_only=True)
class Reaction:
    """Thing, and the program or webhook for when somebody points at it."""

    thing: str
    target: ReactionTarget

    @classmethod
    def parse(cls, text: str, room: Environment | None = None) -> Self:
        """Return the reaction in `THING=PROGRAM ARGUMENTS...` or `THING=URL`. `room`: the map, if known.

        Raises:
            ConfigError: If it is invalid, the map lacks the thing, or the program or URL cannot be used.
        """
        thing, _, line = (part.strip() for part in text.partition("="))
        if not thing or not line:
            raise ConfigError(
                f"{text!r}: write THING=PROGRAM, such as 'screws=./order.sh {{user}}', THING=URL or FILE.yaml"
            )
        is_url = line.startswith(("http://", "https://"))
        try:
            if room is not None:
                check_things([thing], room)
            return cls(thing=thing, target=Webhook.parse(line) if is_url else Program.parse(line))
        except ConfigError as error:
            raise ConfigError(f"{thing}: {error}") from error

    def check(self, room: Environment) -> None:
        """Check that the map has the thing. Raises ConfigError."""
        try:
            check_things([self.thing], room)
        except ConfigError as error:
            raise ConfigError(f"{self.thing}: {error}") from error


def reactions_in(text: str, room: Environment | None = None) -> Iterator[Reaction]:
    """Yield the reactions of a value of `--on`: one, or those of a file `THING: [PROGRAM or URL, ...]`.

    `room`: the map, if known.

    Raises:
        ConfigError: If one cannot be used, or the file is none.
    """
    if "=" in text or not text.endswith(FILES):
        yield Reaction.parse(text, room)
        return
    for thing, lines in read_yaml(Path(text)).items():
        for line in cast("list[object]", lines) if isinstance(lines, list) else [lines]:
            if not isinstance(line, str):
                raise ConfigError(
                    f"{text}: {thing}: write a program or a URL, or a list of them, not {line!r}"
                )
            try:
                yield Reaction.parse(f"{thing}={line}", room)
            except ConfigError as error:
                raise ConfigError(f"{text}: {error}") from error


class Reactions:
    """Watcher of a run that reacts, and ends all with the scenario."""

    def __init__(self, reactions: Sequence[Reaction]) -> None:
        """Do those of `reactions` whose thing is pointed at."""
        self._reactions = reactions
        self._room: Environment | None = None
        self._running: dict[asyncio.Task[str], tuple[str, ReactionTarget]] = {}
        """Reactions without a result, with their description."""
        self._done = 0
        self._failed = 0
        self._dropped = 0
        self._failures: deque[str] = deque(maxlen=MAX_FAILURES)

    def attach(self, bus: Bus, on_event: OnEvent) -> Sequence[Closable]:
        """Subscribe on `bus`. Return the subscription, and a function that ends all reactions."""
        del on_event
        ending = contextlib.ExitStack()
        ending.callback(self._end)
        return ending, bus.subscribe(SELECTION_EVENTS, self._on_event)

    def on_map(self, environment: Environment) -> None:
        """Update the things, and report those that it lacks."""
        self._room = environment
        for reaction in self._reactions:
            try:
                reaction.check(environment)
            except ConfigError as error:
                self._report(str(error))

    def on_service(self, instance: str, *, is_present: bool) -> None:
        """Ignore services."""

    def summary(self) -> Mapping[str, Any]:
        """Return the number of reactions by result, and sentences on failures.

        Those that were started are done, have failed, or still run; at the end of the run, none does.
        """
        counts = {"done": self._done, "failed": self._failed, "dropped": self._dropped}
        started = self._done + self._failed + len(self._running)
        return {"reactions": {"started": started, **counts, "failures": list(self._failures)}}

    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        for reaction in self._reactions:
            if is_reaction(event, [reaction.thing], self._room):
                self._start(event, reaction.target)

    def _start(self, event: SelectionEvent, target: ReactionTarget) -> None:
        values = {
            "thing": event.thing,
            "user": event.user,
            "confidence": "" if event.confidence is None else f"{event.confidence:.2f}",
            "state": "on" if event.is_on else "off",
            "stamp_ns": str(event.stamp_ns),
        }
        description = f"{event.thing}: {target.describe(values)}"
        if len(self._running) >= MAX_AT_ONCE:
            self._dropped += 1
            self._report(f"{description} was not started, as {MAX_AT_ONCE} reactions still run")
            return
        task = asyncio.create_task(target.react(values), name=description)
        self._running[task] = description, target
        task.add_done_callback(self._settle)

    def _settle(self, task: asyncio.Task[str]) -> None:
        """Count the result of `task`, unless the end of the run has counted it."""
        error = None if task.cancelled() else task.exception()
        if task not in self._running:
            return
        description, target = self._running.pop(task)
        if error is not None:
            problem = f"stopped by an unexpected error ({type(error).__name__}: {error})"
        else:
            problem = target.interruption if task.cancelled() else task.result()
        self._count(description, problem)

    def _count(self, description: str, problem: str) -> None:
        if problem:
            self._failed += 1
            self._report(f"{description} {problem}")
        else:
            self._done += 1

    def _report(self, sentence: str) -> None:
        log.warning("%s", sentence)
        self._failures.append(hide_secrets(sentence))

    def _end(self) -> None:
        for task in list(self._running):
            if task.done():
                self._settle(task)
            else:
                task.cancel()
                description, target = self._running.pop(task)
                self._count(description, target.interruption)
