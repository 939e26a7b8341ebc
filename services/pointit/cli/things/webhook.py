"""Requests to web servers when people point at a thing."""

import asyncio
import contextlib
import importlib.util
import ipaddress
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self
from urllib.parse import quote, urlsplit

from pointit.cli.things.program import check_placeholders, filled
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.certificate_errors import certificate_error_in, describe_certificate_error
from pointit.runtime.host.extras import remedy

TIMEOUT_S = 5.0
"""Maximum time of a try, s."""
PAUSES_S = (1.0, 4.0)
"""Pauses before the second and the third try, s."""
TRUST = "set the variable SSL_CERT_FILE to a file with its authority's certificate"
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
            host = urlsplit(url).hostname
        except ValueError as error:
            raise ConfigError(f"{url} is no URL ({error})") from error
        if not host:
            raise ConfigError(f"{url} has no host; write http://HOST/PATH")
        check_placeholders(url)
        if importlib.util.find_spec("httpx") is None:
            raise ConfigError(f"webhooks need an extra: run {remedy('webhooks')}")
        return cls(url=url)

    def describe(self, _values: Mapping[str, str]) -> str:
        """Return its scheme and host: what follows them is often a secret."""
        parts = urlsplit(self.url)
        return f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}/..."

    async def react(self, values: Mapping[str, str]) -> str:
        """Send it, up to three times, always with the same key. Return what went wrong, or `""`."""
        import httpx  # noqa: PLC0415 - an extra

        url = filled(self.url, {name: quote(value, safe="") for name, value in values.items()})
        confidence, stamp = values["confidence"], values["stamp_ns"]
        body = {
            **{name: values[name] for name in ("thing", "user", "state")},
            "confidence": float(confidence) if confidence else None,
            "stamp_ns": int(stamp),
        }
        headers = {
            "Content-Type": "application/json",
            "Idempotency-Key": quote(f"{values['thing']}-{values['user']}-{stamp}"),
        }
        problem = ""
        for pause_s in (0.0, *PAUSES_S):
            await asyncio.sleep(pause_s)
            try:
                # an own transport uses no proxy of the environment
                transport = httpx.AsyncHTTPTransport() if is_local(url) else None
                connection = httpx.AsyncClient(timeout=TIMEOUT_S, transport=transport)
            except (ValueError, ImportError, httpx.InvalidURL) as error:
                return (
                    f"cannot be reached by the proxy that this environment names ({error}): correct "
                    "all_proxy, http_proxy and https_proxy, or name its host in no_proxy"
                )
            except OSError as error:
                return f"was not sent, as the file of SSL_CERT_FILE cannot be used ({error}): correct it"
            try:
                async with asyncio.timeout(TIMEOUT_S), connection as client:
                    answer = await client.post(url, content=json.dumps(body), headers=headers)
            except (TimeoutError, httpx.TimeoutException):
                problem = f"did not answer within {TIMEOUT_S:g} s"
            except (httpx.HTTPError, httpx.InvalidURL, OSError) as error:
                refusal = certificate_error_in(error)
                cause = str(error) or type(error).__name__
                if refusal is not None:
                    cause = describe_certificate_error(refusal, "the server", TRUST)
                problem = f"could not be reached ({cause})"
            else:
                if answer.is_success:
                    return ""
                problem = f"answered {answer.status_code} {answer.reason_phrase}".rstrip()
                if answer.status_code < SERVER_ERROR and answer.status_code != TOO_MANY_REQUESTS:
                    return problem
        return f"{problem}, {1 + len(PAUSES_S)} times"


def is_local(url: str) -> bool:
    """Return True if the host of `url` is this machine or in its network, to which no proxy leads.

    These are loopback, private and link-local addresses, names without a dot, and those below `.local` and
    `.localhost`.
    """
    host = (urlsplit(url).hostname or "").rstrip(".")
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host).is_private
    return "." not in host or host.endswith((".local", ".localhost"))
