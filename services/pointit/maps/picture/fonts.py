"""Fonts with the letters of a figure: names of things and files may be of any script."""

import contextlib
from collections.abc import Iterator
from typing import Any

import matplotlib.font_manager
from matplotlib.text import Text

font_manager: Any = matplotlib.font_manager
"""Its types are partly unknown."""
LAST_RESORT = "Last Resort"
"""Begin of the name of a font that has a box for each letter."""
REPLACEMENT = "?"
"""Drawn for a letter that no font has."""


def use_fonts_with_letters(figure: Any) -> str:
    """Draw the texts of `figure` in fonts that have their letters. Return the letters that no font has."""
    texts = [each for each in figure.findobj(Text) if not each.get_text().isascii()]
    texts += [each for each in figure.findobj(Text) if not each.get_text().replace("\n", "").isprintable()]
    missing = {letter for each in texts for letter in each.get_text() if letter != "\n"}
    if not missing:
        return ""
    families: list[str] = []
    for family, font in _fonts():
        if there := {letter for letter in missing if font.get_char_index(ord(letter))}:
            families.append(family)
            missing -= there
        if not missing:
            break
    for each in texts:
        each.set_fontfamily([*each.get_fontfamily(), *families])
        each.set_text("".join(REPLACEMENT if letter in missing else letter for letter in each.get_text()))
    return "".join(sorted(missing))


def _fonts() -> Iterator[tuple[str, Any]]:
    """Yield families and fonts: the usual one first, then those without serifs."""
    default = font_manager.FontProperties()
    yield default.get_family()[0], font_manager.get_font(font_manager.findfont(default))
    names = {
        entry.name for entry in font_manager.fontManager.ttflist if not entry.name.startswith(LAST_RESORT)
    }
    for name in sorted(names, key=lambda name: ("sans" not in name.lower(), name)):
        with contextlib.suppress(OSError, RuntimeError, ValueError):  # a font that cannot be read
            properties = font_manager.FontProperties(family=[name])
            font = font_manager.get_font(font_manager.findfont(properties, fallback_to_default=False))
            if font.scalable:
                yield name, font
