# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""Queries to other sessions, and refusals of theirs. Nothing waits on Zenoh's threads or in the loop."""

import asyncio
import contextlib
import logging
from typing import Any

import zenoh
from zenoh.handlers import Callback

log = logging.getLogger(__name__)


async def query_replies(
    session: zenoh.Session | zenoh.Liveliness, selector: str, **asked: Any
) -> list[zenoh.Reply]:
    """Return all that others answer, as it comes; a task that is cancelled waits for nothing more.

    Args:
        session: asks; its `liveliness()` for tokens.
        selector: what for.
        asked: what else its `get` takes.
    """
    loop = asyncio.get_running_loop()
    done = asyncio.Event()
    replies: list[zenoh.Reply] = []

    def finish() -> None:  # on Zenoh's thread
        with contextlib.suppress(RuntimeError):  # the loop is gone
            loop.call_soon_threadsafe(done.set)

    token = zenoh.CancellationToken()
    session.get(selector, Callback(replies.append, finish, indirect=False), cancellation_token=token, **asked)
    try:
        await done.wait()
    except asyncio.CancelledError:
        loop.run_in_executor(None, token.cancel)
        raise
    return replies


async def query_samples(
    session: zenoh.Session, selector: str, *, timeout_s: float, under_any_key: bool = False
) -> list[zenoh.Sample]:
    """Return all samples with which others answer, in order of arrival, and nothing if Zenoh cannot ask.

    Args:
        session: asks.
        selector: what for.
        timeout_s: who answers later is not waited for.
        under_any_key: answers may be about other keys than the one that is asked for.
    """
    try:
        replies = await query_replies(
            session,
            selector,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=timeout_s,
            allowed_destination=zenoh.Locality.REMOTE,
            accept_replies=zenoh.ReplyKeyExpr.ANY if under_any_key else None,
        )
    except zenoh.ZError as error:  # who asks in the background asks again: it must not end
        log.warning("%s cannot be asked for: %s", selector, error)
        return []
    return [each.ok for each in replies if each.ok is not None and each.ok.kind == zenoh.SampleKind.PUT]


def refuse(query: zenoh.Query, reason: str) -> None:
    """Answer `query` with an error: without an answer the caller would wait for its time-out."""
    with query, contextlib.suppress(zenoh.ZError):  # the caller is gone, or our session is
        query.reply_err(reason.encode())
