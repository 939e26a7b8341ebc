"""Text of any script that may be shown: letters of all writing systems, without what hides or reorders text.

Python's `isprintable` knows no script: it refuses the joiners that Persian, Hindi, Bengali and emoji are
written with, the number signs of Arabic, and emoji that are newer than its tables.
"""

import unicodedata

REPLACEMENT = "?"
JOINERS = "\u200c\u200d"
"""Zero-width non-joiner and joiner (UAX 31, 2.3): they are text between letters that join."""
DIRECTION_MARKS = "\u061c\u200e\u200f"
"""Marks beside right-to-left text. Embeddings, overrides and isolates are none: they reorder what follows."""
VISIBLE_FORMATS = frozenset(
    "\u0600\u0601\u0602\u0603\u0604\u0605\u06dd\u070f\u0890\u0891\u08e2\U000110bd\U000110cd"
)
"""Format characters with a glyph, such as the number sign of Arabic."""
MONGOLIAN_SEPARATOR = "\u180e"
NEW_EMOJI = range(0x1F000, 0x1FB00)
"""Blocks of emoji, also of those that the tables of this Python lack."""
JOINED_CATEGORIES = frozenset(("Lo", "Lm", "Mn", "Mc", "So", "Sk", "Sm"))
"""Categories beside a joiner: letters without case, marks, symbols. In Latin it would hide a difference."""
VIRAMA = 9
"""Combining class of the sign after which a joiner may also end a word, as in Malayalam (RFC 5892, A.1)."""
RIGHT_TO_LEFT = frozenset(("R", "AL"))


def is_printable(text: str) -> bool:
    """Return True if each character of `text` can be shown, so that it is a name on one line.

    Spaces of all kinds are characters, such as that of Japanese; tabs and line breaks are none.
    """
    if text.isprintable():
        return True
    return all(_is_shown(text, index) for index in range(len(text)))


def plain(text: str, replacement: str = REPLACEMENT) -> str:
    """Return `text` with `replacement` for each character that cannot be shown: controls and overrides.

    Line breaks stay; tabs and all kinds of spaces become spaces.
    """
    if text.isprintable():
        return text
    letters: list[str] = []
    for index, letter in enumerate(text):
        if letter == "\t" or unicodedata.category(letter) == "Zs":
            letters.append(" ")
        elif letter == "\n" or _is_shown(text, index):
            letters.append(letter)
        else:
            letters.append(replacement)
    return "".join(letters)


def _is_shown(text: str, index: int) -> bool:
    """Return True if the character at `index` of `text` can be shown beside its neighbors."""
    letter = text[index]
    if letter.isprintable() or letter in VISIBLE_FORMATS:
        return True
    category = unicodedata.category(letter)
    if category == "Zs":
        return True
    if category == "Cn":
        return ord(letter) in NEW_EMOJI
    if letter in DIRECTION_MARKS:
        letters = (each for each in text if each not in DIRECTION_MARKS)
        return any(unicodedata.bidirectional(each) in RIGHT_TO_LEFT for each in letters)
    if letter in JOINERS or letter == MONGOLIAN_SEPARATOR:
        if index > 0 and unicodedata.combining(text[index - 1]) == VIRAMA:
            return True
        neighbors = text[index - 1 : index] + text[index + 1 : index + 2]
        return len(neighbors) == 2 and all(map(_joins, neighbors))
    return False


def _joins(letter: str) -> bool:
    """Return True for a character that may stand beside a joiner."""
    is_new = unicodedata.category(letter) == "Cn" and ord(letter) in NEW_EMOJI
    return is_new or unicodedata.category(letter) in JOINED_CATEGORIES
