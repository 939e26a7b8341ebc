"""Text for people: foreign text made safe to show, mistakes in data, rounded numbers; secrets are hidden."""

import errno
import os
import re
import socket
from collections.abc import Iterable, Sequence

from pydantic_core import ErrorDetails

from pointit.schemas.printable import JOINERS, plain

LONGEST_SENTENCE = 600
"""Characters of a foreign sentence that are shown."""
MAX_LISTED = 4
"""Number of names that `few_of` lists."""

_WANTED = {
    "greater_than": "must be above {gt}", "greater_than_equal": "must be at least {ge}",
    "less_than": "must be below {lt}", "less_than_equal": "must be at most {le}",
    "finite_number": "must be a finite number", "literal_error": "use one of {expected}",
    "bool": "write true or false", "dict": "write a mapping of names to values", "float": "write a number",
    "int": "write a whole number", "list": "write a list such as [a, b]", "path": "write the path of a file",
    "string": "write text", "tuple": "write a list such as [a, b]", "missing": "is missing; give it a value",
    "extra_forbidden": "is no field of it; leave it out",
}  # fmt: skip
"""Advice by pydantic's error type, or by its first word (`int_parsing`, `int_type`)."""

SECRET_NAME = re.compile(
    r"token|passw(or)?d|passphrase|secret|credential|authorization|cookie|key$", re.IGNORECASE
)
"""Part of the name of a field whose value is a secret."""
LANGUAGE = r"^([A-Za-z]{2,3}(-[A-Za-z0-9]{2,8}){0,3})?$"
"""Pattern of the tag of a language, such as `de` or `en-GB`, or of `""`."""
_SPACE = re.compile(r"\s+")
_NUMBERS = re.compile(r"\[Errno -?\d+\] |\[[A-Z\d_]+: [A-Z\d_]+\] | \(_ssl\.c:\d+\)")
"""Numbers of errors of the system, and names and places of those of OpenSSL."""
_WEB_ADDRESS = re.compile(r"\b(https?|wss?)://([^\s'\"<>`]{1,4096})", re.IGNORECASE)
_HOST = re.compile(r"(\[[^\]]*\]|[^:]*)(:\d*)?")
_NAME = r"(?:token|passw(?:or)?d|passphrase|secret|(?:api|access|private)[_-]?key)s?"
_HIDDEN = (
    re.compile(r"(://)[^\s'\"<>`]{1,256}(?=@)"),
    re.compile(r"(?<![\w.+%-])()[\w.+%-]{1,64}:[^\s@/'\"]{1,128}(?=@[\w\[])"),
    re.compile(
        r"(?i)((?:authorization|cookie|x-[\w-]{0,32}(?:key|token))['\"]?\s?[:=,]\s?(?:b?['\"])?)[^'\"\n]{1,4096}"
    ),
    re.compile(r"(?i)\b(bearer )[\w+/=.~-]{6,}"),
    re.compile(r"()\beyJ[\w-]{4,512}\.[\w.-]{1,4096}"),  # JSON Web Token
    re.compile(
        rf"(?i)({_NAME}(?:['\"]\s?[:,]\s?|['\"]?\s?=\s?)|--[\w-]{{0,32}}{_NAME}\s)"
        r"(?:b?\"[^\"]{1,4096}\"?|b?'[^']{1,4096}'?|[^\s,;&'\")\]}]{1,4096})"
    ),
)
"""Patterns of secrets; their group stays. Lengths are bounded: text of a peer must not take long."""


def all_of(names: Iterable[str]) -> str:
    """Return `names` as `a, b and c`."""
    all_names = list(names)
    if len(all_names) < 2:
        return "".join(all_names)
    *first, last = all_names
    return f"{', '.join(first)} and {last}"


def few_of(names: Sequence[str]) -> str:
    """Return `names` as `all_of`, or of more than `MAX_LISTED` as `a, b, c and 3 more`."""
    if len(names) <= MAX_LISTED:
        return all_of(names)
    return first_of(names, MAX_LISTED - 1)


def first_problem(problems: Sequence[str]) -> str:
    """Return the first of `problems`, with the number of others as `a (2 more)`, or `""`."""
    if not problems:
        return ""
    others = len(problems) - 1
    if not others:
        return problems[0]
    return f"{problems[0]} ({others} more)"


def first_of(names: Iterable[str], most: int) -> str:
    """Return the first `most` of `names` as `a, b and 3 more`. Those of a full list end in `a, b`."""
    all_names = list(names)
    more = len(all_names) - most
    shown = ", ".join(all_names[:most])
    return f"{shown} and {more} more" if more > 0 else shown


def system_reason(error: BaseException, most: int = LONGEST_SENTENCE) -> str:
    """Return the reason of an error of the system or a connection, without error numbers and addresses.

    Text for people has an `OSError` by this function only: `str(error)` begins with `[Errno 111]`.
    """
    # Errors of names and of TLS have numbers of their own. An import of ssl would take 27 ms.
    number = 0
    if isinstance(error, OSError) and not isinstance(error, socket.gaierror):
        number = error.errno or 0
    if number in errno.errorcode and type(error).__module__ != "ssl":
        return os.strerror(number).lower()
    return one_line(_NUMBERS.sub("", str(error)), most) or "no answer"  # several addresses were tried


def one_line(text: str, most: int = LONGEST_SENTENCE) -> str:
    """Return `text` as `plain`, on one line and of at most `most` characters."""
    # cut before the search, which takes long on a long text
    shown = plain(_SPACE.sub(" ", text[: 2 * most]).strip())
    if len(shown) <= most:
        return shown
    begin = shown[: most - 1].rstrip(JOINERS)
    return f"{begin}…"


def hide_secrets(text: str) -> str:
    """Return `text` without what may be a secret.

    Scheme and host of web addresses stay, as paths may have tokens. In other addresses and `USER:PASSWORD@`,
    user and password become `***`, and so do JSON Web Tokens, the values of `token=`, `"password":` and
    similar names, and of the headers Authorization and Cookie.
    """
    text = _WEB_ADDRESS.sub(_shown_web_address, text)
    for pattern in _HIDDEN:
        text = pattern.sub(r"\1***", text)
    return text


def _shown_web_address(match: re.Match[str]) -> str:
    address = match[2].rstrip(".,;:!)]")
    authority, *after = re.split(r"[/?#]", address, maxsplit=1)
    host = authority.rpartition("@")[2]
    if not _HOST.fullmatch(host):  # a password with a slash in it
        host = "***"
    path = "/..." if any(after) else "/" * len(after)
    rest = match[2][len(address) :]
    return f"{match[1]}://{host}{path}{rest}"


def round_beyond(value: float, limit: float = 0.0, digits: int = 1) -> str:
    """Return `value` rounded to `digits` behind the point, on the same side of `limit` as `value`.

    A message that compares both stays true: 0.52 beyond a limit of 0.5 is "0.6", not "0.5".
    """
    rounded = round(value, digits)
    step = 10.0**-digits
    if value > limit >= rounded:
        rounded += step
    elif value < limit <= rounded:
        rounded -= step
    return f"{rounded:.{digits}f}"


def describe_mistake(detail: ErrorDetails) -> str:
    """Return a message on a value that pydantic refuses, without the value."""
    kind = detail["type"]
    wanted = _WANTED.get(kind)
    if wanted is None and kind.endswith(("_type", "_parsing", "_from_float")):
        wanted = _WANTED.get(kind.partition("_")[0])
    if wanted is None:
        return detail["msg"].removeprefix("Value error, ").replace("Input should ", "must ")
    context = detail.get("ctx", {})
    limits = {name: str(value).removesuffix(".0") for name, value in context.items()}
    return wanted.format(**limits)
