# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""Asking other processes for samples that they have kept."""

import asyncio
import contextlib

import zenoh
from zenoh.handlers import Callback


async def kept_samples(
    session: zenoh.Session, selector: str, *, timeout_s: float, under_any_key: bool = False
) -> list[zenoh.Sample]:
    """Return all samples with which others answer, as they come; none when nobody does.

    Args:
        session: asks.
        selector: what for.
        timeout_s: who answers later is not waited for.
        under_any_key: answers may be about other keys than the one that is asked for.
    """
    loop = asyncio.get_running_loop()
    done = asyncio.Event()
    samples: list[zenoh.Sample] = []

    def take(reply: zenoh.Reply) -> None:  # on Zenoh's thread
        if reply.ok is not None and reply.ok.kind == zenoh.SampleKind.PUT:
            samples.append(reply.ok)

    def finish() -> None:  # on Zenoh's thread
        with contextlib.suppress(RuntimeError):  # the loop is gone
            loop.call_soon_threadsafe(done.set)

    token = zenoh.CancellationToken()
    session.get(
        selector,
        Callback(take, finish, indirect=False),
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=timeout_s,
        allowed_destination=zenoh.Locality.REMOTE,
        cancellation_token=token,
        accept_replies=zenoh.ReplyKeyExpr.ANY if under_any_key else None,
    )
    try:
        await done.wait()
    except asyncio.CancelledError:
        loop.run_in_executor(None, token.cancel)
        raise
    return samples
