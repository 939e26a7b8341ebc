"""Tables on narrow terminals leave columns out rather than break words."""

import io

import pytest
from rich.console import Console

from pointit.cli.common.output import ROOMY_WIDTH, Section, print_table

SECTION = Section(
    name="things", about="of a test", rows=({"name": "a", "detail": "b"},), roomy=frozenset({"detail"})
)


@pytest.mark.parametrize(("width", "shown"), [(ROOMY_WIDTH - 1, False), (ROOMY_WIDTH, True)])
def test_a_narrow_terminal_does_without_the_roomy_columns(*, width: int, shown: bool) -> None:
    text = io.StringIO()
    print_table(Console(file=text, width=width), SECTION)
    assert "name" in text.getvalue()
    assert ("detail" in text.getvalue()) is shown
