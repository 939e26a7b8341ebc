"""Acts of tests, and the failures of targets that carry them out."""

from collections.abc import Callable
from typing import Any

from pointit.runtime.service.carrier import Act, ActFailedError, Target
from pointit.schemas import SelectionEvent


def act_on(thing: str, tell_started: Callable[[], None] = lambda: None, **fields: Any) -> Act:
    """Return the act of anna on a thing."""
    usual = {"stamp_ns": 7, "event": "selected", "object_id": thing, "user": "anna"}
    return Act(SelectionEvent.model_validate(usual | fields), tell_started)


async def failure_of(target: Target, act: Act) -> tuple[str, str]:
    """Carry out an act. Return code and sentence of its failure, empty if it is done."""
    try:
        await target.carry_out(act)
    except ActFailedError as error:
        return error.code, str(error)
    return "", ""
