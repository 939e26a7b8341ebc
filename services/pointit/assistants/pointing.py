"""Referents of a person's pointing, now or at the time of a word, and waiting for it."""

from collections.abc import Collection

from pointit.api.site import Site
from pointit.assistants.data import MAX_SENTENCE, PossibleReferent, PossibleReferents, Waited, plain
from pointit.assistants.room_items import check_present, current
from pointit.errors import AccessDeniedError, NoAnswerError
from pointit.schemas import NS_PER_S
from pointit.schemas.person import Deictic

MAX_CANDIDATES = 8
LOOK_S = 0.2
"""Time between two looks while waiting, s."""
SURE = 0.6
"""Least probability of what is waited for."""
ITEMS = ("thing", "robot", "object", "person")
"""Kinds of referents that have a name of their own."""


async def pointed(site: Site, user: str, at_ns: int | None, word: Deictic = "") -> PossibleReferents:
    """Return the candidates for what `user` pointed at, at `at_ns` of the site's time, or now.

    Raises:
        PointItError: If they are not there, nobody keeps where they point, or that time is not kept.
    """
    await check_present(site, user)
    try:
        found = await site.listener.referents(user, at_ns, word=word)
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
    candidates = [
        PossibleReferent(
            kind=each.kind,
            name=plain(each.name),
            probability=round(each.probability, 3),
            position_m=each.place_m,
        )
        for each in found.candidates[:MAX_CANDIDATES]
    ]
    return PossibleReferents(
        user=user,
        seconds_ago=round(ago_s, 2),
        candidates=tuple(candidates),
        none=round(found.none, 3),
        note=plain(found.message, MAX_SENTENCE),
    )


async def wait_for(site: Site, user: str, names: Collection[str], timeout_s: float) -> Waited:
    """Wait until `user` points at one of `names`, or at anything that has a name if there are none.

    Raises:
        PointItError: If they are not there, or nobody keeps where they point.
    """
    last = await pointed(site, user, None)
    before, looked_ns = "", 0
    feed = site.cursors(user)
    try:
        async for cursor in feed.during(timeout_s):
            if cursor.stamp_ns - looked_ns < LOOK_S * NS_PER_S:
                continue
            looked_ns = cursor.stamp_ns
            last = await pointed(site, user, None)
            name = _sure_of(last, names)
            if name and name == before:  # two looks, so that a hand that passes by does not count
                return Waited(came=True, pointed=last)
            before = name
    finally:
        feed.close()
    return Waited(came=False, pointed=last)


def _sure_of(seen: PossibleReferents, names: Collection[str]) -> str:
    """Return the name of what is pointed at, if it is surely one of `names`, else `""`."""
    for best in seen.candidates[:1]:
        is_wanted = best.name in names if names else best.kind in ITEMS
        return best.name if is_wanted and best.probability >= SURE else ""
    return ""
