"""Runs the programs and sends the webhooks of `--on`, each the target of a thing.

No core: it waits for programs and servers.
"""

import asyncio
import contextlib
import importlib
import json
import os
import re
import shlex
import shutil
import signal
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Self, cast
from urllib.parse import quote, urlsplit

from pointit.runtime.address_config import parse_address
from pointit.runtime.config.nearest_name import nearest
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import pointit_version, remedy
from pointit.runtime.host.tls_errors import (
    certificate_error_in,
    describe_certificate_error,
    describe_tls_error,
    tls_error_in,
)
from pointit.runtime.service.carrier import Act, ActFailedError, check_things
from pointit.schemas import Environment, ThingState
from pointit.schemas.selection import FailureCode
from pointit.schemas.text import hide_secrets, one_line, system_reason

if TYPE_CHECKING:
    import httpx


MAX_S = 60.0
"""Time after which a program is ended, s."""
STARTED_S = 2.0
"""Time after which it is reported that a program has started, s."""
GRACE_S = 1.0
"""Time from SIGTERM to SIGKILL, s."""
PLACEHOLDER = re.compile(r"\{(\w+)\}")
PLACEHOLDERS = ("thing", "user", "confidence", "state")

WEBHOOK_TIMEOUT_S = 5.0
"""Maximum time of an attempt, s."""
PAUSES_S = (1.0, 4.0)
"""Pauses before the second and the third attempt, s."""
AUTHORITY_HINT = "set the variable SSL_CERT_FILE to a file with its authority's certificate"
CERTIFICATE_HINT = "write an address that asks for none"
MAX_REASON = 200
"""Number of characters of a server's text that are shown."""
SUCCESS = 200
REDIRECT = 300
TOO_MANY_REQUESTS = 429
SERVER_ERROR = 500

FILES = (".yaml", ".yml")


def check_placeholders(text: str) -> None:
    """Check that all placeholders in `text` are known. Raises ConfigError."""
    for name in PLACEHOLDER.findall(text):
        if name not in PLACEHOLDERS:
            hint = nearest(name, PLACEHOLDERS)
            raise ConfigError(f"there is no {{{name}}}; {hint}")


def values_of(act: Act) -> Mapping[str, str]:
    """Return the values of `PLACEHOLDERS`."""
    event = act.event
    confidence = "" if event.confidence is None else f"{event.confidence:.2f}"
    return {
        "thing": act.thing,
        "user": event.user,
        "confidence": confidence,
        "state": "on" if act.on else "off",
    }


def filled(text: str, values: Mapping[str, str]) -> str:
    """Return `text` with the values of its placeholders, all of which are in `PLACEHOLDERS`."""
    return PLACEHOLDER.sub(lambda match: values[match[1]], text)


@dataclass(frozen=True, kw_only=True)
class Program:
    """A program with its arguments, in which there are placeholders."""

    arguments: Sequence[str]
    is_shown: bool = False
    """True if its output is that of this process."""

    @property
    def state(self) -> ThingState:
        """Return the limit, which is longer than its own."""
        return ThingState(id="", limit_s=MAX_S + 2.0 * GRACE_S)

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
        program = arguments[0]
        has_placeholder = PLACEHOLDER.search(program) is not None
        if not has_placeholder and shutil.which(program) is None:
            raise ConfigError(f"no program {program}; give a path, and `chmod +x` a script")
        return cls(arguments=arguments)

    async def carry_out(self, act: Act) -> None:
        """Run it, and end all that it has started. Raise ActFailedError if it did not end with 0."""
        nothing = asyncio.subprocess.DEVNULL
        output = None if self.is_shown else nothing
        values = values_of(act)
        arguments = [filled(argument, values) for argument in self.arguments]
        name = shlex.join(arguments)
        act.check_in_time()

        # Start it in a session of its own, whose process group has all that it starts
        try:
            program = await asyncio.create_subprocess_exec(
                *arguments, stdin=nothing, stdout=output, stderr=output, start_new_session=True
            )
        except OSError as error:
            reason = system_reason(error)
            raise ActFailedError("error", f"{name} could not be started ({reason})") from error

        # Wait for its end. The start of a program that runs for long is reported
        started_timer = asyncio.get_running_loop().call_later(STARTED_S, act.tell_started)
        try:
            async with asyncio.timeout(MAX_S):
                code = await program.wait()
        except TimeoutError:
            problem = f"{name} was ended after {MAX_S:g} s"
            raise ActFailedError("no_answer", problem) from None
        finally:
            started_timer.cancel()
            await _end_group(program.pid)
        if code:
            status = f"exit code {code}" if code > 0 else f"signal {-code}"
            raise ActFailedError("error", f"{name} ended with {status}")


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


@dataclass(frozen=True, kw_only=True)
class Webhook:
    """A URL that gets a request with a JSON object: `thing`, `user`, `state`, `confidence`, `stamp_ns`."""

    url: str

    @property
    def state(self) -> ThingState:
        """Return the limit, which is longer than that of three attempts with their pauses."""
        return ThingState(id="", limit_s=30.0)

    @classmethod
    def parse(cls, url: str) -> Self:
        """Return the webhook with this URL, in which there may be placeholders.

        Raises:
            ConfigError: If it has no host, an unknown placeholder, or the extra is missing.
        """
        # A URL with a host and perhaps a port, both of which raise if they are malformed
        try:
            parts = urlsplit(url)
            host = parts.hostname
            _port = parts.port
            if host:
                _user, _at, host_and_port = parts.netloc.rpartition("@")
                parse_address(host_and_port)
        except ValueError as error:
            # an unquoted / in a password ends the host, and the error has the rest of it
            raise ConfigError(
                f"{hide_secrets(url)} is no URL: write http://HOST:PORT/PATH, with %2F for / in a password"
            ) from error
        if not host:
            raise ConfigError(f"{hide_secrets(url)} has no host; write http://HOST/PATH")
        check_placeholders(url)

        # The extra, imported now, as that takes longer than an event loop may be blocked
        try:
            importlib.import_module("pointit.services.reactions.http_status")
        except ImportError as error:
            raise ConfigError(f"webhooks need an extra: run {remedy('webhooks')}") from error
        return cls(url=url)

    def describe(self) -> str:
        """Return its scheme and host: what follows them is often a secret."""
        without_path = urlsplit(self.url)._replace(path="/...", query="", fragment="")
        return hide_secrets(without_path.geturl())

    async def carry_out(self, act: Act) -> None:
        """Send it, up to three times, always with the same key. Raise ActFailedError if that fails."""
        code, problem = await self._send(act)
        if problem:
            raise ActFailedError(code, f"{self.describe()} {problem}")

    async def _send(self, act: Act) -> tuple[FailureCode, str]:
        """Return kind and description of the failure, or `""`."""
        import httpcore  # noqa: PLC0415 - of an extra
        import httpx  # noqa: PLC0415 - an extra

        from pointit.services.reactions.http_status import open_pool, post  # noqa: PLC0415 - as above

        try:
            request = self._request(act)
        except (httpx.InvalidURL, UnicodeError) as error:
            return "error", f"was not sent, as its address is not valid ({error}): correct it"

        # Errors of connections and servers are retried, since they may pass. Those of settings are not
        problem = ""
        code = cast("FailureCode", "no_answer")
        for pause_s in (0.0, *PAUSES_S):
            await asyncio.sleep(pause_s)
            act.check_in_time()
            try:
                async with asyncio.timeout(WEBHOOK_TIMEOUT_S):
                    try:
                        pool = await asyncio.to_thread(open_pool, request.url)
                    except (ValueError, ImportError, httpx.InvalidURL) as error:
                        problem = (
                            f"cannot be reached by the proxy that this environment names ({error}): correct "
                            "all_proxy, http_proxy and https_proxy, or name its host in no_proxy"
                        )
                        return "error", problem
                    except OSError as error:
                        reason = system_reason(error)
                        problem = (
                            f"was not sent: the file of SSL_CERT_FILE cannot be used ({reason}): correct it"
                        )
                        return "error", problem
                    async with pool:
                        status, reason = await post(pool, request)
            except (TimeoutError, httpcore.TimeoutException):
                problem = f"did not answer within {WEBHOOK_TIMEOUT_S:g} s"
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
                    return "", ""
                # a refusal is final, unless the server is overloaded or has an error
                code = "refused"
                shown_reason = one_line(reason, MAX_REASON)
                problem = f"answered {status} {shown_reason}".rstrip()
                if status < SERVER_ERROR and status != TOO_MANY_REQUESTS:
                    return code, problem
        attempts = 1 + len(PAUSES_S)
        return code, f"{problem}, {attempts} times"

    def _request(self, act: Act) -> "httpx.Request":
        """Return the request, always the same one for the same event.

        Raises:
            httpx.InvalidURL: If the values of placeholders make no host.
        """
        import httpx  # noqa: PLC0415 - an extra

        # Values are quoted, so that none adds a part to the address
        values = values_of(act)
        quoted_values = {name: quote(value, safe="") for name, value in values.items()}
        url = httpx.URL(filled(self.url, quoted_values))
        thing = values["thing"]
        user = values["user"]
        confidence = values["confidence"]
        stamp_ns = act.event.stamp_ns
        body = {
            "thing": thing,
            "user": user,
            "state": values["state"],
            "confidence": float(confidence) if confidence else None,
            "stamp_ns": stamp_ns,
        }

        # Servers recognize a repeated request by its key
        headers = {
            "Accept-Encoding": "identity",
            "Connection": "close",
            "Content-Type": "application/json",
            "Idempotency-Key": quote(f"{thing}-{user}-{stamp_ns}"),
            "User-Agent": f"PointIt/{pointit_version()}",
        }
        request = httpx.Request("POST", url, headers=headers, content=json.dumps(body))
        if url.username or url.password:
            authentication = httpx.BasicAuth(url.username, url.password)
            next(authentication.auth_flow(request))
        return request


def _cause(error: Exception) -> str:
    """Return the reason for an error of a connection, and the remedy for one of TLS."""
    certificate_error = certificate_error_in(error)
    if certificate_error is not None:
        return describe_certificate_error(certificate_error, "the server", AUTHORITY_HINT)
    tls_error = tls_error_in(error)
    if tls_error is not None:
        return describe_tls_error(tls_error, "the server", CERTIFICATE_HINT)
    return one_line(str(error), MAX_REASON) or type(error).__name__


@dataclass(frozen=True, kw_only=True)
class Reaction:
    """Thing, and the program or webhook for when somebody points at it."""

    thing: str
    target: Program | Webhook

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
            target = Webhook.parse(line) if is_url else Program.parse(line)
            return cls(thing=thing, target=target)
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
    for thing, value in read_yaml(Path(text)).items():
        lines = cast("list[object]", value) if isinstance(value, list) else [value]
        for line in lines:
            if not isinstance(line, str):
                raise ConfigError(
                    f"{text}: {thing}: write a program or a URL, or a list of them, not {line!r}"
                )
            try:
                yield Reaction.parse(f"{thing}={line}", room)
            except ConfigError as error:
                raise ConfigError(f"{text}: {error}") from error
