"""Check of the remedies in sentences for people: what is printed to be typed can be typed."""

import re
import shlex

from pointit.launch.plan.launches import Settings, layers_of, service_of
from pointit.schemas.topics import REQUESTS, TOPICS
from pointit.services import registry

NAMES = {each.placeholder for each in (*TOPICS, *REQUESTS)} - {""}
PLACEHOLDER = re.compile(r"\{(?:" + "|".join(sorted(NAMES)) + r")\}")
"""A name that should have been filled in, as in `users/{user}/imu`."""
OPTION = "--set "
BESIDE = {
    "feeders": {"feeders": {"a": {"sequence": ["a"]}}},
    "osc": {"osc": {"first": 1, "sensor_position": 0}},
}
"""Parameters beside which some are given only."""


def set_options(text: str) -> list[str]:
    """Return the value of each `--set` in a sentence, without the punctuation after it."""
    values: list[str] = []
    for part in text.split(OPTION)[1:]:
        lexer = shlex.shlex(part, posix=True, punctuation_chars="`")
        lexer.whitespace_split, lexer.commenters, lexer.escape = True, "", ""
        values.append(next(lexer).rstrip(",;:.)”"))
    return values


def check_sentence(text: str) -> None:
    """Check that no placeholder is left in `text` and that each `--set` is one that `pointit run` accepts."""
    found = PLACEHOLDER.search(text)
    assert found is None, f"{found and found[0]} in: {text}"
    for setting in set_options(text):
        check_setting(setting)


def check_setting(setting: str) -> None:
    """Parse `SERVICE.PARAMETER=VALUE` as `pointit run --set` does."""
    service = service_of(setting)
    below = next((each for part, each in BESIDE.items() if f".{part}." in setting), {})
    layers_of(service, {"scenario": below}, Settings(settings=[setting])).build(
        registry.process(service).config()
    )
