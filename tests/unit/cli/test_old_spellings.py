"""Spellings of version 0.1: they do what the new ones do, and a note on standard error names those."""

import pytest
from click.testing import CliRunner, Result

from pointit.cli.commands import OLD_SPELLINGS
from pointit.cli.main import PATHS, command


def invoke(words: str) -> Result:
    return CliRunner().invoke(command, words.split(), prog_name="pointit")


@pytest.mark.parametrize(
    ("old", "new", "rest"),
    [
        ("topics", "topic list", "--json"),
        ("schema", "topic schema", "Cursor"),
        ("call", "service call", "--json"),
        ("pose", "person pose", "anna x"),
        ("user", "person add", "--help"),
        ("calibrate", "person calibrate", "mounting --help"),
        ("service", "service run", "pui --help"),
        ("service", "service run", "puj"),
        ("service", "service list", "--json"),
    ],
)
def test_an_old_spelling_does_what_the_new_one_does_after_a_note(old: str, new: str, rest: str) -> None:
    before, after = invoke(f"{old} {rest}"), invoke(f"{new} {rest}")
    assert before.output == f"note: `pointit {old}` is now `pointit {new}`\n{after.output}"
    assert before.exit_code == after.exit_code


def test_every_old_spelling_leads_to_a_command_of_the_help_and_is_not_shown_itself() -> None:
    assert set(OLD_SPELLINGS.values()) <= set(PATHS)
    assert not {(word,) for word in OLD_SPELLINGS} & set(PATHS)
    renamed = {old: new[-1] for old, new in OLD_SPELLINGS.items() if old != new[-1]}
    assert renamed == {"topics": "list", "user": "add"}


def test_a_misspelt_action_is_not_taken_for_a_service() -> None:
    assert invoke("service lst").output == "Error: no action 'lst'; did you mean list?\n"
