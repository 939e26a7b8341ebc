"""Sentences of the catalogue for programs in other languages."""

from pointit.schemas.base import MAX_ID
from pointit.schemas.catalogue.asyncapi import document, readme


def test_it_says_how_a_state_is_fetched_what_an_error_is_and_how_long_ids_are() -> None:
    for text in (readme(), document()["info"]["description"]):
        assert "A `get` on `KEY/@adv/**?_anyke` returns the last value of the state `KEY`" in text
        assert "An error reply is one sentence, UTF-8" in text
        assert f"Ids have at most {MAX_ID} characters" in text
