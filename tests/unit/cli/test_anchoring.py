"""Anchors that are given up: what may have begun is called off, what somebody else has begun is not."""

import asyncio
from typing import Literal

import pytest

from pointit.cli.people.anchoring import Anchoring
from pointit.schemas import CancelLocalization, Done, Localization, PointAnchor
from pointit.schemas.topics import CANCEL_LOCALIZATION, LOCALIZATION, POINT_ANCHOR
from tests.support.bench import memory_bench, until

ANNA = "anna"


@pytest.mark.parametrize(("phase", "called_off"), [("idle", ["cancel"]), ("sampling", [])])
async def test_who_gives_up_before_the_answer_leaves_no_lamp_lit(
    phase: Literal["idle", "sampling"], called_off: list[str]
) -> None:
    asked: list[str] = []

    async def point(_query: PointAnchor, _user: str) -> Done:
        asked.append("anchor")
        await asyncio.Event().wait()
        return Done()

    async def cancel(_query: CancelLocalization, _user: str) -> Done:
        asked.append("cancel")
        return Done()

    async with memory_bench() as bench:
        bench.bus.serve(POINT_ANCHOR, point, ANNA)
        bench.bus.serve(CANCEL_LOCALIZATION, cancel, ANNA)
        bench.put(LOCALIZATION, Localization(stamp_ns=1, phase=phase, since_ns=1), ANNA)
        pointing = asyncio.create_task(Anchoring(bench.bus, ANNA).point("led_1", 5.0, lambda _text: None))
        await until(lambda: asked == ["anchor"])
        pointing.cancel()
        with pytest.raises(asyncio.CancelledError):
            await pointing
    assert asked == ["anchor", *called_off]
