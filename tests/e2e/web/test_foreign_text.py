"""Text of others in a browser: labels, names, words, problems and requests are text, and nothing else."""

import asyncio
import time
from typing import Any

import pytest
from playwright.async_api import Browser

from pointit.bridges.web.server import access, app
from pointit.bridges.web.server.access import RequestInfo
from pointit.runtime.clock import WallClock
from pointit.schemas import (
    Announced,
    Deployment,
    Environment,
    Feedback,
    Health,
    Interaction,
    Localization,
    Message,
    SelectionEvent,
    ThingState,
    ThingStates,
    TrackedObject,
    TrackedObjects,
    Understood,
    topics,
)
from pointit.schemas.environment import Thing
from pointit.schemas.problems import Problem
from pointit.schemas.system import Figure
from pointit.schemas.topics import Topic
from tests.e2e.web.conftest import page_is_built
from tests.e2e.web.window import NO_WEBGL, Window
from tests.integration.web.pages import OPERATOR, serving
from tests.support.bench import Bench, memory_bench
from tests.support.pace import Patience

pytestmark = pytest.mark.slow

EVIL = "<img src=x onerror=window.evil=1><script>window.evil=2</script>"
HOSTILE = (
    EVIL,
    "\"'><svg/onload=window.evil=3>",
    "javascript:window.evil=4",
    "{{constructor.constructor('window.evil=5')()}}",
    "</textarea></title></style><iframe srcdoc='<script>parent.evil=6</script>'>",
    "\u202e\u2066" + "\U0001f4a5" * 40,
)
USER = "eve"
SHOWN_S = 4.0
"""Time for which hostile messages are repeated while the page shows them, s."""
POLICY = "Content-Security-Policy"
STRICT = "require-trusted-types-for 'script'; trusted-types 'none'"
"""Further policy, in which assigning markup to a document raises an error."""
FOREIGN = """() => [...document.querySelectorAll(
  "img[src=x], iframe, script:not([src]), svg[onload], [onerror]"
)].map((element) => element.outerHTML)"""
TEXT = "() => document.body.innerText"


def room() -> Environment:
    """Return a map whose things have hostile labels."""
    things = tuple(
        Thing(id=f"thing{index}", label=label, center_m=(2.5, index - 2.0, 1.3), size_m=(0.2, 0.2, 0.2))
        for index, label in enumerate(HOSTILE)
    )
    return Environment(stamp_ns=1, name=EVIL, things=things)


async def publish_everything(bench: Bench, text: str) -> None:
    """Put each message whose text a page shows, with `text` in all its fields of text."""
    now_ns = time.time_ns()
    problem = Problem(code="connection", sentence=text, subject=text[:100], topic=text[:100])
    health = Health(
        stamp_ns=now_ns,
        service="pointing",
        instance=f"pointing.{USER}",
        user=USER,
        pid=7,
        host=text,
        status="degraded",
        warnings=(text,),
        problems=(problem,),
        figures=(Figure(name=text[:64], value=1.0, unit=text[:16]),),
    )
    box = TrackedObject(id=text, kind=text, position_m=(2.0, 0.5, 1.0), surface_id=text, bay=text)
    event = SelectionEvent(
        stamp_ns=now_ns, event="refused", object_id=text, kind=text, user=USER, reason=text
    )
    state = ThingState(id="thing0", state="unavailable", reason=text)
    deployment = Deployment(stamp_ns=now_ns, name=text, scenario=text, scenarios=(text,), goal=text[:200])
    understood = Understood(stamp_ns=now_ns, text=text, command=text, result="refused", message=text)
    localization = Localization(stamp_ns=now_ns, phase="refused", target_id=text, reason=text)
    interaction = Interaction(stamp_ns=now_ns, state="pointing", next_step=text, reason=text)
    messages: list[tuple[Topic[Any], str, Message]] = [
        (topics.HEALTH, f"pointing.{USER}", health),
        (topics.OBJECTS, "evil", TrackedObjects(stamp_ns=now_ns, objects=(box,))),
        (topics.SELECTION_EVENTS, "", event),
        (topics.THING_STATES, "evil", ThingStates(stamp_ns=now_ns, things=(state,))),
        (topics.DEPLOYMENT, USER, deployment),
        (topics.UNDERSTOOD, USER, understood),
        (topics.LOCALIZATION, USER, localization),
        (topics.INTERACTION, USER, interaction),
        (topics.FEEDBACK, USER, Feedback(stamp_ns=now_ns, cue="refused", text=text, target_id=text)),
        (topics.ANNOUNCED, USER, Announced(stamp_ns=now_ns, object_id=text, label=text, began_ns=now_ns)),
    ]
    for topic, name, message in messages:
        bench.put(topic, message, name)
        await asyncio.sleep(0)


@pytest.mark.parametrize("is_stricter", [False, True], ids=["own policy", "trusted types"])
async def test_hostile_text_is_shown_as_text_and_runs_nothing(
    browser: Browser, monkeypatch: pytest.MonkeyPatch, *, is_stricter: bool
) -> None:
    page_is_built()

    def stricter_headers(info: RequestInfo) -> dict[str, str]:
        usual = access.headers(info)
        return {**usual, POLICY: f"{usual[POLICY]}; {STRICT}"}

    if is_stricter:
        monkeypatch.setattr(app, "headers", stricter_headers)
    async with memory_bench(WallClock()) as bench, serving(bench) as server:
        bench.bus.announce(topics.USER_ALIVE, USER)
        bench.bus.announce(topics.SERVICE_ALIVE, f"pointing.{USER}")
        bench.put(topics.MAP, room())
        window = await Window.open(browser, f"{server.url}/?token={OPERATOR}", scripts=(NO_WEBGL,))
        await window.until("Boolean(window.pointit?.site?.map)", "the map")
        patience = Patience(SHOWN_S)
        while not patience.is_over():
            for text in HOSTILE:
                await publish_everything(bench, text)
            await asyncio.sleep(0.5)
        shown = await window.page.evaluate(TEXT)
        assert EVIL in shown, "it is shown literally"
        assert await window.page.evaluate("window.evil ?? null") is None
        assert await window.page.evaluate(FOREIGN) == []
        assert await window.violations() == []
        assert window.faults == []
        await window.page.close()
