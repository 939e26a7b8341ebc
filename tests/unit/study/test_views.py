"""Pages and the terminal of a study: who may open them, what their messages and keys do, what is refused."""

import asyncio
import json
from collections.abc import AsyncIterator
from dataclasses import replace
from typing import Any

import httpx
import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import InvalidStatus

from pointit.cli.study import TerminalView
from pointit.study.page.server import served
from pointit.study.page.view import MAX_REASON, Page, PageView
from pointit.study.questionnaire import SUS, Scale
from pointit.study.session import StoppedError
from pointit.study.study_step import Picture, StudyStep
from pointit.study.view import StudyCommand, StudyStatus

STATUS = StudyStatus(
    participant="P01", trial=2, block=1, condition="hold", left=3, state="pointing", trials=4
)


def shown(view: PageView) -> dict[str, Any]:
    return view.content("participant")


async def begun(work: Any) -> asyncio.Task[Any]:
    task = asyncio.create_task(work)
    await asyncio.sleep(0)
    return task


@pytest.mark.parametrize(
    ("page", "text", "problem"),
    [
        ("participant", "{", "message: Invalid JSON"),
        ("experimenter", "", "message: Invalid JSON"),
        ("experimenter", "[" * 5000, "message: Invalid JSON"),
        ("experimenter", '{"command": "delete"}', "command: use one of 'repeat'"),
        ("participant", '{"command": "stop"}', "id: is missing"),
        ("experimenter", '{"command": "skip"}', "reason: write why the trial is skipped"),
        (
            "experimenter",
            json.dumps({"command": "skip", "reason": "x" * (MAX_REASON + 1)}),
            "reason: String should have at most 200 characters",
        ),
    ],
)
def test_message_that_cannot_be_obeyed_is_refused_in_words(page: Page, text: str, problem: str) -> None:
    view = PageView("small", "P01")
    assert view.hear(page, text).startswith(problem)
    assert view.command() is None


async def test_questionnaire_ends_by_a_whole_answer_to_it_only() -> None:
    view = PageView("small", "P01")
    asking = await begun(view.ask(SUS))
    number = shown(view)["id"]
    for answers in ([3] * 9, [3] * 9 + [6], [0] + [3] * 9):
        assert view.hear("participant", json.dumps({"id": number, "answers": answers})).startswith("answers:")
    assert view.hear("participant", json.dumps({"id": number - 1, "answers": [1] * 10})) == ""
    assert view.hear("participant", json.dumps({"id": number, "answers": [3] * 10})) == ""
    assert view.hear("participant", json.dumps({"id": number, "answers": [4] * 10})) == ""  # the first counts
    assert await asking == [3] * 10
    assert shown(view)["show"] == "wait"


async def test_questionnaire_that_comes_again_says_which_block_it_is_on() -> None:
    view = PageView("small", "P01")
    asking = await begun(view.ask(SUS, "block 2 of 3"))
    assert "block 2 of 3" in shown(view)["text"]
    asking.cancel()
    asking = await begun(view.ask(SUS))
    assert shown(view)["text"] == ""
    asking.cancel()


@pytest.mark.parametrize(
    ("answer", "problem"),
    [
        ("", "agrees: write true or false"),
        (', "agrees": null', "agrees: write true or false"),
        (', "agrees": "true"', "agrees: write true or false"),
        (', "agrees": "yes"', "agrees: write true or false"),
        (', "agrees": 1', "agrees: write true or false"),
        (', "agrees": [true]', "agrees: write true or false"),
    ],
)
async def test_nothing_but_true_is_a_consent(answer: str, problem: str) -> None:
    view = PageView("small", "P01")
    telling = await begun(view.tell(StudyStep(text="Do you agree?"), go="agree"))
    number = shown(view)["id"]
    assert view.hear("participant", f'{{"id": {number}{answer}}}').startswith(problem)
    assert shown(view)["id"] == number, "still asked"
    assert view.hear("participant", f'{{"id": {number}, "agrees": false}}') == ""
    assert await telling is False
    telling = await begun(view.tell(StudyStep(text="Do you agree?"), go="agree"))
    assert view.hear("participant", f'{{"id": {number + 1}, "agrees": true}}') == ""
    assert await telling is True


async def test_instruction_needs_no_consent_and_answers_are_whole_numbers() -> None:
    view = PageView("small", "P01")
    telling = await begun(view.tell(StudyStep(text="Read."), go="begin"))
    assert view.hear("participant", f'{{"id": {shown(view)["id"]}}}') == ""
    assert await telling is True
    asking = await begun(view.ask(SUS))
    for answers in ('["3"]', "[true]", "[3.0]"):
        message = f'{{"id": {shown(view)["id"]}, "answers": {answers}}}'
        assert view.hear("participant", message).startswith("answers.0: write a whole number")
    asking.cancel()


async def test_experimenter_can_only_stop_while_the_participant_reads() -> None:
    view = PageView("small", "P01")
    view.status(STATUS)
    assert view.hear("experimenter", '{"command": "skip", "reason": " a\\n b "}') == ""
    assert view.command() == StudyCommand("skip", "a b")
    telling = await begun(view.tell(StudyStep(text="Read."), go="begin"))
    assert view.hear("experimenter", '{"command": "pause"}').startswith("pause: the participant reads")
    assert view.command() is None
    assert view.hear("experimenter", '{"command": "stop"}') == ""
    with pytest.raises(StoppedError, match="P01 is stopped; the same command goes on"):
        await telling


@pytest.fixture
async def links() -> AsyncIterator[tuple[PageView, dict[Page, str]]]:
    view = PageView("small", "P01", {"room.png": Picture(b"a picture", "image/png")})
    async with served(view) as (participants, experimenters):
        yield view, {"participant": participants, "experimenter": experimenters}


def joined(url: str, origin: str = "") -> Any:
    origin = origin or url.rsplit("/", 2)[0]
    return connect(f"{url.replace('http', 'ws', 1)}ws", origin=origin)  # pyrefly: ignore[bad-argument-type]  # a NewType of str


async def received(socket: ClientConnection) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(await socket.recv())
    return content


@pytest.mark.wall_time
async def test_wrong_token_and_foreign_origin_are_refused(links: tuple[PageView, dict[Page, str]]) -> None:
    _, urls = links
    async with httpx.AsyncClient() as client:
        for page in urls:
            answer = await client.get(urls[page])
            assert (answer.status_code, f"/static/{page}.js" in answer.text) == (200, True)
            assert "script-src 'self'" in answer.headers["content-security-policy"]

        url = urls["experimenter"]
        wrong = url[:-2] + ("a" if url[-2] != "a" else "b") + "/"
        answer = await client.get(wrong)
        assert (answer.status_code, "has links of its own" in answer.text) == (403, True)
        assert (await client.get(url, headers={"Host": "evil.example"})).status_code == 403
    for address, origin in ((wrong, ""), (urls["participant"], "http://evil.example")):
        with pytest.raises(InvalidStatus) as refused:
            await joined(address, origin)
        assert refused.value.response.status_code == 403


@pytest.mark.wall_time
async def test_pictures_of_the_steps_are_served_and_nothing_else(
    links: tuple[PageView, dict[Page, str]],
) -> None:
    view, urls = links
    url = urls["participant"]
    telling = await begun(
        view.tell(StudyStep(text="Look."), StudyStep(image="room.png", alt="The room"), go="begin")
    )
    steps = shown(view)["steps"]

    assert [(step["image"], step["alt"]) for step in steps] == [(None, ""), (0, "The room")]
    async with httpx.AsyncClient() as client:
        answer = await client.get(f"{url}image/0")
        assert (answer.content, answer.headers["content-type"]) == (b"a picture", "image/png")
        assert answer.headers["x-content-type-options"] == "nosniff"
        wrong = url.replace(url[-4:-1], "abc" if url[-4:-1] != "abc" else "abd")
        for other in (f"{url}image/1", f"{url}image/-1", f"{url}image/..%2f..%2fview.py", f"{wrong}image/0"):
            assert (await client.get(other)).status_code == 404
    telling.cancel()


@pytest.mark.wall_time
async def test_pages_show_content_to_late_joiners_and_survive_bad_messages(
    links: tuple[PageView, dict[Page, str]],
) -> None:
    view, urls = links
    telling = await begun(view.tell(StudyStep(text="Read <b>this</b>."), go="begin"))
    async with joined(urls["participant"]) as first, joined(urls["experimenter"]) as experimenter:
        content = await received(first)
        assert content["steps"][0]["text"] == "Read <b>this</b>."
        for bad in ("{", b"\x00", '{"id": "x"}', '{"command": "stop"}'):
            await first.send(bad)
            assert "problem" in await received(first)
        async with joined(urls["participant"]) as second:  # another screen, or the same one after a loss
            assert await received(second) == content
            await second.send(json.dumps({"id": content["id"]}))
            assert await telling is True
            assert (await received(first))["show"] == "wait"
        view.status(STATUS)
        while (seen := await received(experimenter))["status"] is None:
            pass

        assert (seen["status"]["trial"], seen["shown"]["title"]) == (2, "Point")
        assert (await received(first))["text"] == "Look at the room."
        view.status(replace(STATUS, say="Land quad at B."))
        assert (await received(first))["text"] == "Land quad at B."

        view.end("You may close this page.")
        while (content := await received(first))["show"] != "end":
            pass


POINTING = StudyStatus(
    participant="P01", trial=3, block=1, condition="hold", left=9, target="", state="pointing"
)


async def typed(view: TerminalView, *lines: str) -> None:
    for line in lines:
        await asyncio.sleep(0)
        view.on_bytes(line.encode())


async def test_keys_are_commands_and_skipping_pauses_until_a_typed_reason(
    capsys: pytest.CaptureFixture[str],
) -> None:
    view = TerminalView()
    view.status(POINTING)
    view.on_bytes(b"rxs")
    view.status(POINTING)  # does not overwrite what is typed
    view.on_bytes(b"slippd\x7fed, q\nq")
    commands = [view.command() for _ in range(5)]
    assert commands == [
        StudyCommand("repeat"),
        StudyCommand("pause"),
        StudyCommand("skip", "slipped, q"),
        StudyCommand("stop"),
        None,
    ]
    assert "P01  trial 3, 9 left  hold  pointing" in capsys.readouterr().out


async def test_skip_during_a_pause_does_not_end_the_pause() -> None:
    view = TerminalView()
    view.status(replace(POINTING, state="paused"))
    view.on_bytes(b"sslipped\n")
    assert [view.command() for _ in range(2)] == [StudyCommand("skip", "slipped"), None]


async def test_participant_is_asked_until_the_answer_is_one(capsys: pytest.CaptureFixture[str]) -> None:
    view = TerminalView()
    scale = Scale(name="own", items=("Easy?", "Fast?"), points=(1, 5))
    async with asyncio.TaskGroup() as group:
        asked = group.create_task(view.ask(scale, "block 1 of 2"))
        await typed(view, "9\n", "yes\n", "4\n", "1\n")
    assert asked.result() == [4, 1]
    assert "Questions on block 1 of 2:" in capsys.readouterr().out

    differential = Scale(name="own", items=("Mood?",), points=(-4, 4), step=2)
    async with asyncio.TaskGroup() as group:
        asked = group.create_task(view.ask(differential))
        await typed(view, "3\n", "-2\n")
    assert asked.result() == [-2]

    for answer, agrees in (("n\n", False), ("y\n", True)):
        async with asyncio.TaskGroup() as group:
            told = group.create_task(view.tell(StudyStep(text="Do you agree?"), go="agree"))
            await typed(view, "\n", answer)
        assert told.result() is agrees
    assert view.command() is None
