"""What callers are told who get no answer."""

from typing import Any

from pointit.runtime.errors import NoAnswerError
from pointit.schemas.topics import Request


def shutting_down(request: Request[Any, Any]) -> str:
    """Return what a caller is told whose server ends."""
    return f"{request.server} is shutting down"


def no_answer(request: Request[Any, Any], key: str, timeout_s: float | None = None) -> NoAnswerError:
    """Return the error that says who should have answered `key`."""
    waited = "" if timeout_s is None else f" within {timeout_s:g} s"
    return NoAnswerError(
        f"{request.server} does not answer {key}{waited}; is it running? See `pointit doctor`"
    )
