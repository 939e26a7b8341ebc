"""Words by the API: a recogniser's go to the topic, and what they refer to comes back."""

import pytest

from pointit.api.site import Site
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.errors import AccessDeniedError, NoAnswerError
from pointit.schemas import FindReferents, Referent, Referents, Speech, Word
from pointit.schemas.topics import FIND_REFERENTS, SPEECH
from tests.support.bench import until

THAT = Word(text="that", start_ns=1, end_ns=5)


async def test_words_of_a_recogniser_are_published_under_the_person(bus: MemoryBus, site: Site) -> None:
    heard: list[tuple[Speech, str]] = []
    bus.subscribe(SPEECH, lambda speech, user: heard.append((speech, user)))
    await site.hear("anna", [THAT], is_final=False)
    await site.hear("anna", [THAT])
    await site.hear("ben", [])
    await until(lambda: len(heard) == 3)
    assert [(user, speech.words, speech.is_final) for speech, user in heard] == [
        ("anna", (THAT,), False),
        ("anna", (THAT,), True),
        ("ben", (), True),
    ]
    assert heard[0][0].stamp_ns == THAT.end_ns


async def test_referents_are_asked_of_the_person_s_listener(bus: MemoryBus, site: Site) -> None:
    asked: list[tuple[FindReferents, str]] = []
    reply = Referents(candidates=(Referent(kind="thing", name="cup", probability=0.9),), none=0.1, rays=9)

    async def find(query: FindReferents, user: str) -> Referents:
        asked.append((query, user))
        return reply

    with pytest.raises(NoAnswerError):
        await site.referents("anna")
    bus.serve(FIND_REFERENTS, find, "anna")
    assert await site.referents("anna", 7, 0.5) == reply
    assert asked == [(FindReferents(at_ns=7, within_s=0.5), "anna")]


@pytest.mark.usefixtures("denied")
async def test_hear_is_denied_without_the_right_to_speak(site: Site) -> None:
    with pytest.raises(AccessDeniedError):
        await site.hear("anna", [THAT])
