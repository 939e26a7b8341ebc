"""Text in cells of tables that people open in spreadsheets."""

UNSAFE = ("=", "+", "-", "@", "\t", "\r")
"""Beginnings of a text that spreadsheets take for a formula; an apostrophe is put before it."""


def neutralize_formula(text: str) -> str:
    """Return `text` so that no spreadsheet takes it for a formula."""
    return f"'{text}" if text.lstrip("'").startswith(UNSAFE) else text


def restore_formula(text: str) -> str:
    """Return the text of which `neutralize_formula` has made `text`."""
    return text[1:] if text.startswith("'") and text.lstrip("'").startswith(UNSAFE) else text
