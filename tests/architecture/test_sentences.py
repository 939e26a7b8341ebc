"""Components tell each other fields, not sentences: no code reads the meaning of our own sentences.

The page's TypeScript has the same rule in `bridges/web/client/sentences.test.mjs`.
"""

import ast
import re
from collections.abc import Iterator

import pytest

from tests.architecture.sources import shipped, shown, tree

SENTENCES = {"reason", "next_step", "sentence", "remedy", "said"}
"""Fields that are sentences for people. `text` is one of a cue, see `CUES`."""
CUES = {"cue", "feedback"}
"""Names of variables whose `text` is a sentence."""
PATTERN_USES = {"compile", "findall", "finditer", "fullmatch", "match", "search", "split", "sub"}
TEXT_USES = {
    "endswith", "find", "index", "partition", "removeprefix", "removesuffix", "replace", "rpartition",
    "startswith",
}  # fmt: skip
WORDS = re.compile(r"[A-Za-z]{2,} \(?[A-Za-z]{2,}")
"""Two words in a regular expression: it reads prose."""

FOREIGN = {
    "HANDSHAKE": "log of Zenoh",
    "CONNECTION_ATTEMPT": "log of Zenoh",
    "PASSWORD": "log of Zenoh",
    "NO_ZENOH": "log of Zenoh",
    "SILENT": "log of Zenoh",
    "DECIDED": "log of Zenoh",
    "SYSTEM_REASON": "errors of Zenoh",
    "IN_USE": "errors of Zenoh",
    "re.search('unknown field `([\\\\w/]+)`', text)": "errors of Zenoh",
    "OLD_NOTE": "comment in a map file, which is replaced as a whole",
}
"""Regular expressions with two words that read no sentence of ours, by their name or source."""

READ_AS_PEOPLE_DO = {
    "'is steered by' in cue.text": "another person has the robot",
    "'past everything' in cue.text": "the arm points past everything",
    "'is yours' in cue.text": "the robot is theirs",
    "self._robot not in cue.text": "which robot",
    "'choose one' in cue.text": "the place is refused",
    "'goes there' in cue.text": "the robot goes to the place",
    "f' {kind}.' in cue.text": "kind of the object to point at",
}
"""Reads by simulated people: they know what people know, which is the sentence."""
KNOWN = {
    "event.reason.endswith(REPEATED_REASON)": "SelectionEvent: the event is told again",
    "self.reason.startswith(NOT_DONE)": "SelectionEvent: it takes back an act that failed",
    "RESTORED in self.reason": "SelectionEvent: it restores what was before a restart",
    "REPORTED in self.reason": "SelectionEvent: the target was changed by somebody else",
}
"""Reads of our own sentences that are left, and the field that each needs. Each that goes is removed here."""

PATTERN_MODULE = "re"
SIMULATED_PEOPLE = "services/user_sim/"


def _is_sentence(node: ast.AST) -> bool:
    """Return True if `node` is a field that is a sentence for people."""
    if not isinstance(node, ast.Attribute):
        return False
    is_of_cue = isinstance(node.value, ast.Name) and node.value.id in CUES
    return node.attr in SENTENCES or (is_of_cue and node.attr == "text")


def _reads_sentence(node: ast.AST) -> bool:
    """Return True if `node` reads the meaning of a sentence: by a pattern, a part of it, or a word in it."""
    if isinstance(node, ast.Compare):
        return isinstance(node.ops[0], ast.In | ast.NotIn) and _is_sentence(node.comparators[0])
    if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
        return False
    if node.func.attr in TEXT_USES:
        return _is_sentence(node.func.value)
    return node.func.attr in PATTERN_USES and any(map(_is_sentence, node.args))


def _has_words(node: ast.AST) -> bool:
    """Return True if `node` makes a regular expression with two words in it."""
    if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute) or not node.args:
        return False
    owner = node.func.value
    is_pattern = isinstance(owner, ast.Name) and owner.id == PATTERN_MODULE
    texts = [each.value for each in ast.walk(node.args[0]) if isinstance(each, ast.Constant)]
    return is_pattern and any(isinstance(each, str) and WORDS.search(each) for each in texts)


def _patterns_of_words(module: ast.Module) -> Iterator[str]:
    """Yield the name, or else the source, of each regular expression with two words in it."""
    names: dict[ast.AST, str] = {}
    for node in ast.walk(module):
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            names[node.value] = node.targets[0].id
    for node in ast.walk(module):
        if _has_words(node):
            yield names.get(node, ast.unparse(node))


def test_no_code_reads_a_sentence_that_a_field_should_tell() -> None:
    found = {
        ast.unparse(node): shown(path)
        for path in shipped()
        for node in ast.walk(tree(path))
        if _reads_sentence(node)
    }
    listed = {**KNOWN, **READ_AS_PEOPLE_DO}
    added = {source: place for source, place in found.items() if source not in listed}
    assert not added, "give the message a field (schemas only gain fields), and read that"
    assert not listed.keys() - found.keys(), "these are gone: remove them from the lists"
    others = [source for source in READ_AS_PEOPLE_DO if not found[source].startswith(SIMULATED_PEOPLE)]
    assert not others, "only simulated people may read sentences"


def test_no_regular_expression_has_words_of_our_own_sentences() -> None:
    found = {source: shown(path) for path in shipped() for source in _patterns_of_words(tree(path))}
    added = {source: place for source, place in found.items() if source not in FOREIGN}
    assert not added, "a fact is a field; sentences of other programs are listed in FOREIGN"
    assert not FOREIGN.keys() - found.keys(), "these are gone: remove them from FOREIGN"


@pytest.mark.parametrize(
    "source",
    [
        "re.search('button to confirm', interaction.next_step)",
        "PATTERN.match(state.reason)",
        "'is yours' in cue.text",
        "problem.sentence.removeprefix('says: ')",
    ],
)
def test_rule_finds_each_form_of_reading(source: str) -> None:
    assert any(_reads_sentence(node) for node in ast.walk(ast.parse(source)))


def test_rule_finds_words_in_patterns() -> None:
    module = ast.parse("A = re.compile(r'button to confirm\\b')\nB = re.compile(r'[a-z]+ *')")
    assert list(_patterns_of_words(module)) == ["A"]
