"""The tokens of a site's pages: the same at every start, as long as nobody else could have read them."""

from pathlib import Path

import pytest

from pointit.launch import page
from pointit.launch.page import TokenFile, stored_tokens


def kept_at(state: Path, site: str = "lab") -> Path:
    return state / site / "web" / "tokens.json"


def test_tokens_of_a_site_persist_in_a_private_file(own_state: Path) -> None:
    tokens, notes = stored_tokens("lab")
    assert not notes
    assert stored_tokens("lab") == (tokens, ())
    assert kept_at(own_state).stat().st_mode & 0o777 == 0o600
    assert kept_at(own_state).parent.stat().st_mode & 0o777 == 0o700
    assert [path.name for path in kept_at(own_state).parent.iterdir()] == ["tokens.json"]
    other, _ = stored_tokens("other")
    assert len({tokens.operator, tokens.viewer, other.operator, other.viewer}) == 4
    assert min(len(tokens.operator), len(tokens.viewer)) >= 22


def test_tokens_can_be_renewed() -> None:
    tokens, _ = stored_tokens("lab")
    new, notes = stored_tokens("lab", renew=True)
    assert not {new.operator, new.viewer} & {tokens.operator, tokens.viewer}
    assert not notes
    assert stored_tokens("lab") == (new, ())


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o602])
def test_tokens_that_others_could_read_or_change_are_replaced(own_state: Path, mode: int) -> None:
    tokens, _ = stored_tokens("lab")
    kept_at(own_state).chmod(mode)
    new, (note,) = stored_tokens("lab")
    assert not {new.operator, new.viewer} & {tokens.operator, tokens.viewer}
    assert note.endswith(f"{kept_at(own_state)} could be read by others")
    assert stored_tokens("lab") == (new, ())
    assert kept_at(own_state).stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        '{"operator": "short", "viewer": "short"}',
        f'{{"operator": "{"a" * 24}"}}',
        f'{{"operator": "{"a" * 24}", "viewer": "{"a" * 24}"}}',
        f'{{"operator": "{"a" * 23}&", "viewer": "{"b" * 24}"}}',
        "\0" * 9000,
    ],
)
def test_a_broken_file_is_made_anew_and_not_shown(own_state: Path, text: str) -> None:
    stored_tokens("lab")
    kept_at(own_state).write_text(text)
    new, (note,) = stored_tokens("lab")
    assert note.endswith("does not hold two tokens")
    assert stored_tokens("lab") == (new, ())


def test_tokens_that_cannot_be_stored_are_reported(own_state: Path) -> None:
    own_state.write_text("no folder")
    tokens, notes = stored_tokens("lab")
    assert tokens.operator
    assert "the link of the page is valid for this run only" in notes[-1]


def test_token_file_follows_a_page_that_renews_the_link(own_state: Path) -> None:
    file = TokenFile("lab")
    old = file.current()
    assert (stored_tokens("lab"), file.notes) == ((old, ()), ())
    new, _ = stored_tokens("lab", renew=True)
    assert file.current() == new != old
    kept_at(own_state).unlink()
    assert file.current() == new, "a link is not revoked by a file that is missing"
    newest, _ = stored_tokens("lab")
    assert file.current() == newest != new


def test_token_file_that_others_can_read_changes_nothing(own_state: Path) -> None:
    file = TokenFile("lab")
    old = file.current()
    stored_tokens("lab", renew=True)
    kept_at(own_state).chmod(0o644)
    assert file.current() == old
    kept_at(own_state).chmod(0o600)
    assert file.current() == stored_tokens("lab")[0] != old


def test_two_processes_that_start_at_once_have_the_same_tokens(
    own_state: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other one creates the file between our look and our writing."""
    create = page.create_atomically

    def create_later(path: Path, content: bytes) -> bool:
        monkeypatch.setattr(page, "create_atomically", create)
        first, _ = stored_tokens("lab")
        tokens.append(first)
        return create(path, content)

    tokens: list[page.PageTokens] = []
    monkeypatch.setattr(page, "create_atomically", create_later)
    assert stored_tokens("lab") == (tokens[0], ())
    assert [path.name for path in kept_at(own_state).parent.iterdir()] == ["tokens.json"]
