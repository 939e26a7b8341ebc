"""Remedies in sentences for people: each can be typed or done, and ends these faults."""

import re
import shlex
from collections.abc import Collection, Iterator
from typing import Any, Literal

from pointit.diagnosis.observation import Finding
from pointit.launch.plan.launches import Settings, layers_of, service_of
from pointit.schemas.topics import REQUESTS, TOPICS
from pointit.services import registry
from tests.unit.deploy.stack import parse
from tests.unit.diagnosis.fault_sites import Site
from tests.unit.diagnosis.situations import Fault

Way = Literal["command", "option", "act"]

ACTS = {
    "no identity": "give your identity by --credentials",
    "other site": "use that site's credentials",
    "site": "name the right one: --site",
    "foreign identity": "start it with its own credentials instead of those of",
    "bare process": "give it credentials by --credentials",
    "no device": "plug the device in",
    "idle arm": "take it in the page",
    "load": "end other programs there",
    "blocking call": "it must call what blocks in a thread",
    "flood": "report this place",
    "full disk": "make room there",
    "clock": "synchronize both by NTP: `timedatectl set-ntp true`",
    "second process": "end all but one",
    "version": "a writer of another version? ",
    "message": "end what writes them there",
    "slow link": "check the link to their writer",
    "ended": "start it, or correct `url`",
    "no broker": "start it, or correct its address",
    "killed carrier": "start it again",
    "mute": "restart Home Assistant",
    "entity": "correct `home_assistant` in the map",
    "no bridge": "to `pointit run`, and its address and token by --config",
    "controller": "switch it on, or use its address",
    "battery": "charge it",
}
"""Words that tell people what to do by hand, by the kind of fault that it ends where the finding names it."""


def text_of(finding: Finding) -> str:
    """Return all that doctor prints of a finding."""
    return f"{finding.service}: {finding.sentence} {finding.remedy}"


def commands(text: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield path and parameters of each `pointit COMMAND ...` in backquotes, as the command line reads it.

    Credentials are left out, since they would be read.
    """
    for part in text.split("`")[1::2]:
        program, *words = re.sub(r" --credentials \S+", "", part).split()
        if program == "pointit" and not words[0].startswith("-"):
            yield parse(words)


def faults_ended_by_commands(finding: Finding, healthy: Site) -> Iterator[tuple[str, str]]:
    """Yield kind and object of the faults that end when all printed commands are carried out."""
    text = text_of(finding)
    for path, given in commands(text):
        match path:
            case "run":
                yield "ended", "site" if given["site_only"] else "run"
            case "router":
                yield "ended", "router"
            case _ if path.startswith("service run "):
                user = given.get("user")
                service = path.rpartition(" ")[2]
                yield "ended", healthy.process_of(f"{service}.{user}" if user else service)
            case "person add" if given["name"] == "NAME":
                yield from (("ended", name) for name in healthy.processes)
            case "person add":
                yield "ended", given["name"]
            case "person anchor":
                yield "pose", given["user"]
            case "site renew":
                yield from (("identity", name) for name in given["names"])
            case _:
                pass
    for pid in re.findall(r"`kill -CONT (\d+|PID)`", text):
        is_looked_up = pid == "PID"  # where it runs
        of_pid = (name for name, each in healthy.processes.items() if str(each.pid) == pid)
        yield "stopped", finding.service if is_looked_up else next(of_pid)


def ended_faults(finding: Finding, faults: Collection[Fault], healthy: Site) -> dict[Fault, Way]:
    """Return those of `faults` that end by what `finding` asks for, and the way in which it is done."""
    text = text_of(finding)
    typed = set(faults_ended_by_commands(finding, healthy))
    ways: dict[Fault, Way] = {}
    for fault in faults:
        if (fault.kind, fault.of) in typed:
            ways[fault] = "command"
        elif fault.kind == "setting" and fault.of in set_options(text):
            ways[fault] = "option"
        elif fault.kind in ACTS and ACTS[fault.kind] in text and fault.of in text:
            ways[fault] = "act"
    return ways


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
        lexer.whitespace_split = True
        lexer.commenters = ""
        lexer.escape = ""
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
