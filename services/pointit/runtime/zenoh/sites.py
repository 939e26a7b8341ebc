# pyright: reportUnknownMemberType=false
# (the stubs of zenoh leave types out)
"""Sites that run at an address. A member sees only its own."""

import zenoh

from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.queries import query_replies
from pointit.runtime.zenoh.session import close_session, configuration, open_cancellable
from pointit.schemas.table_types import NAME
from pointit.schemas.topics import ANY, SERVICE_ALIVE

ASK_S = 1.0
MAX_SITES = 20
"""Names that are told: more are of no use to anybody."""


async def sites_at(link: Link) -> tuple[str, ...]:
    """Return the names of the sites with services at the addresses of `link`, whatever its site.

    Empty where nobody answers, or where the router's rules show other sites to nobody.
    """
    config = configuration(link)
    config.insert_json5("namespace", "null")
    try:
        session = await open_cancellable(config)
    except zenoh.ZError:
        return ()
    try:
        selector = f"pointit/*/{SERVICE_ALIVE.at(ANY)}"
        replies = await query_replies(session.liveliness(), selector, timeout=ASK_S)
    finally:
        await close_session(session)
    found = {str(reply.ok.key_expr).split("/")[1] for reply in replies if reply.ok is not None}
    return tuple(sorted(filter(NAME.match, found)))[:MAX_SITES]  # anybody can have written them
