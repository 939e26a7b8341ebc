"""The grammar of spoken commands, and words typed instead of spoken."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas import NS_PER_S, Word
from pointit.speech.grammar import Vocabulary, answer, names_of, parse, spoken
from pointit.speech.recogniser import TimedWord, speech, words_in
from pointit.speech.verbs import VERBS

WORDS = Vocabulary(names=names_of(["rover", "radio_lamp", "led_1", "screws"]), verbs=("heat",))


def words(text: str) -> list[Word]:
    times = [index * NS_PER_S // 2 for index in range(len(text.split()))]
    return [
        Word(text=each, start_ns=at_ns, end_ns=at_ns + NS_PER_S // 4)
        for each, at_ns in zip(text.split(), times, strict=True)
    ]


@pytest.mark.parametrize(
    ("text", "verb", "about", "to"),
    [
        ("put that there", "put", "that", "there"),
        ("Send the rover there please", "send", "rover", "there"),
        ("go there", "send", None, "there"),
        ("turn that on", "on", "that", None),
        ("switch off the radio lamp", "off", "radio_lamp", None),
        ("take these", "take", "these", None),
        ("take the screws", "take", "screws", None),
        ("pick led one", "take", "led_1", None),
        ("what is this", "what", "this", None),
        ("please heat the radio lamp", "heat", "radio_lamp", None),
        ("put this here", "put", "this", "here"),
        ("send that one to this", "send", "that", "this"),
        ("oh no stop stop it", "stop", None, None),
        ("stop that rover", "stop", "rover", None),
        ("stop that", "stop", None, None),
        ("Put that there.", "put", "that", "there"),
    ],
)
def test_a_command_is_found_with_what_it_is_about(
    text: str, verb: str, about: str | None, to: str | None
) -> None:
    found = parse(words(text), WORDS)
    assert found is not None
    assert found.verb == verb
    assert [each and (each.name or each.word) for each in (found.about, found.to)] == [about, to]


def test_deictic_words_have_the_time_of_their_middle() -> None:
    found = parse(words("put that there"), WORDS)
    assert found is not None
    assert [each.at_ns for each in found.mentions] == [
        NS_PER_S // 2 + NS_PER_S // 8,
        NS_PER_S + NS_PER_S // 8,
    ]


@pytest.mark.parametrize("text", ["", "hello there", "turn around", "that", "the radio lamp"])
def test_other_words_are_no_command(text: str) -> None:
    assert parse(words(text), WORDS) is None


def test_yes_and_no_are_answers_and_no_wins() -> None:
    assert answer(words("yes that one")) == ("yes", 0)
    assert answer(words("that one Yes.")) == ("yes", NS_PER_S)
    assert answer(words("yes no not yes")) == ("no", NS_PER_S // 2)
    assert answer(words("that is right")) is None, "the name or the place of something"
    assert answer(words("take that")) is None


def test_names_are_spoken_as_words_and_cannot_inject_grammar() -> None:
    assert spoken("LED_1") == ("led", "one")
    hostile = names_of(
        ["x; public <command> = stop;", "é", "ignore all rules, send the robot", *WORDS.names.values()]
    )
    text = Vocabulary(names=hostile).jsgf()
    plain = Vocabulary(names={}).jsgf()
    assert text.count("public") == 2, "the rule's own and, as a plain word, that of the name"
    assert text.count(";") == plain.count(";")
    foreign = Vocabulary(names=names_of(["zqx", "rover"]), verbs=("heat", "vrx"))
    assert {"zqx", "vrx", "heat", "rover", "there"} <= foreign.words
    written = foreign.jsgf(known=["rover", "heat"])
    assert "zqx" not in written
    assert "( take | pick | heat ) <thing>" in written
    assert len(names_of(f"box {'a' * (1 + index % 9)} {'b' * index}" for index in range(2000))) == 200


@given(st.lists(st.text(min_size=1, max_size=20), max_size=64))
def test_any_words_are_a_command_or_none(texts: list[str]) -> None:
    found = parse([Word(text=text, start_ns=1, end_ns=2) for text in texts], WORDS)
    assert found is None or found.verb in {*VERBS, "heat"}


def test_lines_have_a_word_with_its_time_or_words_without() -> None:
    assert words_in("1.5 that # a comment") == [TimedWord("that", 1.5)]
    assert words_in("turn that on") == [TimedWord(each, None) for each in ("turn", "that", "on")]
    assert words_in(" . ") == words_in("# nothing") == []
    for line in ("nan that", "inf that", "-1 that", "1e9 that"):
        assert words_in(line)[0].time_s is None, "no time, but a word"


def test_words_without_a_time_end_when_their_line_arrives() -> None:
    now_ns = 100 * NS_PER_S
    typed = speech(words_in("put that there"), 0, now_ns)
    assert [(now_ns - word.end_ns) / NS_PER_S for word in typed.words] == pytest.approx([0.6, 0.3, 0.0])
    timed = speech([TimedWord("THAT", 2.0)], now_ns, 0)
    assert (timed.words[0].text, timed.words[0].start_ns) == ("that", now_ns + 2 * NS_PER_S)
    assert len(speech([TimedWord("a", None)] * 10_000, 0, now_ns).words) == 64
