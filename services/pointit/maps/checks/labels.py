"""Checks of the labels of things, which are spoken to people: alike in sound, or too long."""

import re
import unicodedata
from collections.abc import Iterator, Sequence

from pointit.maps.checks.finding import MapFinding, warning
from pointit.schemas import Thing

SYLLABLE_S = 0.2
"""Time of one spoken syllable, s: synthesizers say four to five a second."""
MAX_SPOKEN_S = 0.6
"""Time above which a name is slow to point by, s."""
LETTERS = str.maketrans(
    {
        **dict.fromkeys("aeiouyhw", "a"),
        **dict.fromkeys("bpfv", "p"),
        **dict.fromkeys("dt", "t"),
        **dict.fromkeys("cgkqjx", "k"),
        **dict.fromkeys("sz", "s"),
        **dict.fromkeys("mn", "n"),
        **dict.fromkeys("lr", "l"),
    }
)
"""Letters whose sounds are mistaken for each other, by the groups of Soundex."""
NAMED = 10
"""Number of slow labels that are named."""
DIGITS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")


def check_labels(things: Sequence[Thing]) -> Iterator[MapFinding]:
    """Yield labels that sound alike, and one finding for those that take long to speak.

    Equal labels are left out, since `check_things` reports them; so are ids that are too long.
    """
    sounds: dict[str, tuple[str, str]] = {}
    slow: list[str] = []
    for thing in things:
        label = thing.label or thing.id
        words = spoken_words(label)
        duration_s = SYLLABLE_S * sum(map(syllable_count, words))
        if thing.label and duration_s > MAX_SPOKEN_S + 1e-9:
            slow.append(f"{label!r} ({duration_s:.1f} s)")
        sound = " ".join(map(sound_of, words))
        duplicate, other = sounds.setdefault(sound, (thing.id, label)) if sound else (thing.id, label)
        if duplicate != thing.id and other != label:
            text = f"{label!r} sounds like {other!r} of {duplicate}; change one label"
            yield warning(f"things.{thing.id}", text)
    if slow:
        more = f" and {len(slow) - NAMED} more" if len(slow) > NAMED else ""
        listed = f"{', '.join(slow[:NAMED])}{more}"
        limit = f"labels take longer than {MAX_SPOKEN_S:g} s to speak: {listed}"
        yield warning("things", f"{limit}; give shorter ones if names are spoken")


def spoken_words(label: str) -> list[str]:
    """Return the words of a label in small Latin letters without accents. Digits are words."""
    plain = unicodedata.normalize("NFKD", label).casefold()
    spelled = re.sub(r"[0-9]", lambda digit: f" {DIGITS[int(digit.group())]} ", plain)
    letters = "".join(each for each in spelled if not unicodedata.combining(each))
    return re.findall(r"[^\W_]+", letters)


def syllable_count(word: str) -> int:
    """Return the approximate number of syllables: groups of vowels, without a silent e at the end."""
    groups = len(re.findall(r"[aeiouy]+", word))
    is_silent = word.endswith("e") and not word.endswith("le") and groups > 1
    return max(groups - is_silent, 1)


def sound_of(word: str) -> str:
    """Return one letter for each sound of `word`. A single letter is spoken by its name."""
    return word if len(word) == 1 else re.sub(r"(.)\1+", r"\1", word.translate(LETTERS))
