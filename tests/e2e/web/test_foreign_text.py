"""Text of others in a browser: labels, names, words, problems and requests are text, and nothing else."""

import asyncio
import json
import time
from pathlib import Path

import pytest
from playwright.async_api import Browser, Route

from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import (
    Announced,
    Deployment,
    Feedback,
    Health,
    Interaction,
    Localization,
    SelectionEvent,
    ThingState,
    ThingStates,
    TrackedObject,
    TrackedObjects,
    Understood,
    topics,
)
from pointit.schemas.problems import Problem
from pointit.schemas.system import Figure
from tests.e2e.web.site import running
from tests.e2e.web.window import Window
from tests.support.commands import Commands
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
STRICT = "require-trusted-types-for 'script'; trusted-types 'none'"
"""Further policy, in which assigning markup to a document raises an error."""
FOREIGN = """() => [...document.querySelectorAll("img[src=x], iframe, script:not([src]), svg[onload], [onerror]")]
  .map((element) => element.outerHTML)"""
TEXT = "() => document.body.innerText"


def room(folder: Path) -> Path:
    """Write a map whose things have hostile labels."""
    things = "".join(
        f"  thing{index}: {{label: {json.dumps(label)}, center: [2.5, {index - 2.0}, 1.3], "
        "size: [0.2, 0.2, 0.2]}\n"
        for index, label in enumerate(HOSTILE)
    )
    path = folder / "room.yaml"
    path.write_text(f"things:\n{things}", encoding="utf-8")
    return path


async def publish_everything(bus: ZenohBus, text: str) -> None:
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
    for topic, name, message in (
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
    ):
        bus.publisher(topic, name).put(message)
        await asyncio.sleep(0)


@pytest.mark.parametrize("is_stricter", [False, True], ids=["own policy", "trusted types"])
async def test_hostile_text_is_shown_as_text_and_runs_nothing(
    commands: Commands, tmp_path: Path, browser: Browser, *, is_stricter: bool
) -> None:
    site = await running(
        commands, str(room(tmp_path)), "--imu", "page", "--duration", "600", state=tmp_path / "state"
    )

    async def add_policy(route: Route) -> None:
        answer = await route.fetch()
        policy = f"{answer.headers['content-security-policy']}; {STRICT}"
        await route.fulfill(response=answer, headers={**answer.headers, "content-security-policy": policy})

    bus = await ZenohBus.open(Link(connect=(site.endpoint,)))
    try:
        tokens = [
            bus.announce(topics.USER_ALIVE, USER),
            bus.announce(topics.SERVICE_ALIVE, f"pointing.{USER}"),
        ]
        window = await Window.open(browser, "about:blank")
        if is_stricter:
            await window.page.route("**/*", add_policy)
        await window.page.goto(site.url)
        await window.is_shown()
        patience = Patience(SHOWN_S)
        while not patience.is_over():
            for text in HOSTILE:
                await publish_everything(bus, text)
            await window.is_drawn_anew()
        shown = await window.page.evaluate(TEXT)
        assert EVIL in shown, "it is shown literally"
        assert await window.page.evaluate("window.evil ?? null") is None
        assert await window.page.evaluate(FOREIGN) == []
        assert await window.violations() == []
        assert [fault for fault in window.faults if "foreign" not in fault] == []
        for token in tokens:
            token.close()
    finally:
        await bus.close()
