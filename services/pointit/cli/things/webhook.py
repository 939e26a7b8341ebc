"""Requests to web servers when people point at a thing."""

import asyncio
import importlib.util
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self
from urllib.parse import quote, urlsplit

from pointit.cli.things.program import check_placeholders, filled
from pointit.runtime.config.network_address import parse_address
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.certificate_errors import certificate_error_in, describe_certificate_error
from pointit.runtime.host.extras import pointit_version, remedy
from pointit.schemas.text import hide_secrets, one_line

if TYPE_CHECKING:
    import httpx

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
