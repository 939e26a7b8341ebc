"""Topic and request of the arm."""

from pointit.plugins import Delivery, Message, Query, Reply, Request, Topic


class ArmState(Message):
    """The work of the arm: `lost`, `moving`, `holding`, `hovering` or `idle`, for whom, its last words."""

    phase: str = "idle"
    user: str = ""
    over: str = ""
    """Box above which the hand hovers, or goes."""
    holds: str = ""
    text: str = ""


class PutBack(Query):
    """Lay the box that the arm holds, or has begun to take, where it was."""


class PutBackReply(Reply):
    """The arm's answer, a sentence."""

    text: str


ARM_STATE = Topic(
    key="arm/state",
    message=ArmState,
    delivery=Delivery.STATE,
    rate_hz=None,
    writers=("arm",),
    about="what the arm hovers over, holds and says",
)
PUT_BACK = Request(
    key="arm/put_back", query=PutBack, reply=PutBackReply, server="arm", about="lay the box where it was"
)
