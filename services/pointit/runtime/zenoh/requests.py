# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""Asking and answering over Zenoh."""

import asyncio
import functools
from collections.abc import Iterable
from typing import TypeVar

import zenoh

from pointit.runtime.bus.endpoints import RequestHandler, no_answer, shutting_down
from pointit.runtime.errors import RefusedError, RequestError
from pointit.runtime.zenoh.queries import MAX_WAITING, OverflowCounter, QueuedQueryable, query_replies, refuse
from pointit.runtime.zenoh.wire_format import check_size, decoded, encoding_of, name_from_key
from pointit.schemas import DecodeError, Query, Reply, SchemaError, encode
from pointit.schemas.text import one_line
from pointit.schemas.topics import Request

Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)
EMPTY_RETRY_S = (0.01, 0.03, 0.1, 0.3)
"""Waits between tries when nobody answered: a server that was just declared may not be known yet."""


def answer_others(
    session: zenoh.Session, handler: RequestHandler[Q, R], key: str, overflows: OverflowCounter
) -> QueuedQueryable:
    """Have `handler` answer the callers of other processes that ask for `key`."""
    request = handler.request

    def work(query: zenoh.Query) -> Iterable[None]:
        try:
            name = name_from_key(request, str(query.key_expr))
            asked = decoded(request.query, query.payload, query.encoding)
        except SchemaError as error:
            refuse(query, str(error))
        else:
            handler.handle(asked, name).add_done_callback(functools.partial(_reply, request, query))
        return ()

    return QueuedQueryable(
        session,
        key,
        work,
        overflows,
        about=request.key,
        busy=f"{request.server} is busy with {MAX_WAITING} other requests for {request.key}; ask later",
        check=lambda query: check_size(request.query, query.payload),
    )


def _reply(request: Request[Q, R], query: zenoh.Query, answer: asyncio.Task[R]) -> None:
    if answer.cancelled():
        refuse(query, shutting_down(request))
    elif error := answer.exception():
        refuse(query, str(error))
    else:
        with query:
            payload = encode(answer.result())
            query.reply(str(query.key_expr), payload, encoding=encoding_of(request.reply))


async def send_query(
    session: zenoh.Session, request: Request[Q, R], key: str, query: Q, timeout_s: float
) -> R:
    """Return the reply; an empty answer is tried again: the server may just be arriving.

    Raises:
        RequestError: as `Bus.call`.
    """
    for wait_s in (*EMPTY_RETRY_S, None):
        asked = {"payload": encode(query), "encoding": encoding_of(type(query)), "timeout": timeout_s}
        for reply in await query_replies(session, key, **asked):
            if reply.ok is not None:
                try:
                    result: R = decoded(request.reply, reply.ok.payload, reply.ok.encoding)
                except DecodeError as error:
                    raise RequestError(f"{request.server} sent a broken reply to {key}: {error}") from error
                return result
            if reply.err is not None:
                reason = reply.err.payload.to_bytes().decode(errors="replace")
                if reason != "Timeout":  # Zenoh's own word for it
                    raise RefusedError(one_line(reason))
        if wait_s is not None:
            await asyncio.sleep(wait_s)
    raise no_answer(request, key)
