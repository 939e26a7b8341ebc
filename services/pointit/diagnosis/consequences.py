"""Symptoms that follow from services that do nothing, or do it wrongly. Pure."""

import re
from collections.abc import Callable, Collection

from pointit.diagnosis.observation import Finding, Observation
from pointit.diagnosis.writers import row_of
from pointit.runtime.bus.contract import AnyTopic
from pointit.schemas.system import split_instance
from pointit.services.registry import person_of

DISORDERED = re.compile(
    r"came later than others before them|were older than those before them|"
    r"IMU samples made no ray, the last is"
)
"""Warnings about the times of messages."""


def find_consequences(services: Collection[str], seen: Observation) -> Callable[[Finding], bool]:
    """Return a test for symptoms of others that follow if `services` do nothing, or do it wrongly."""
    written = {topic for each in services for topic in _topics(each, "writes")}
    names = {split_instance(each)[0] for each in services}
    affected = _readers(services, seen)

    def follows(each: Finding) -> bool:
        if each.code == "no-cursor":
            return bool(names & {split_instance(instance)[0] for instance in each.services})
        if each.service not in affected:
            return False
        if each.code in ("stale", "slow"):
            return True
        is_mentioned = any(topic.key in each.sentence for topic in written) or any(
            re.search(rf"\b{re.escape(name)}\b", each.sentence) for name in names
        )
        return each.code == "warning" and (is_mentioned or bool(DISORDERED.search(each.sentence)))

    return follows


def _readers(services: Collection[str], seen: Observation) -> set[str]:
    """Return `services` and those that read what they write, directly or through others."""
    affected = set(services)
    new = set(services)
    while new:
        written = [(person_of(each), topic) for each in new for topic in _topics(each, "writes")]
        new = {
            each
            for each in seen.present - affected
            if any(
                topic in _topics(each, "reads") and (not person or person_of(each) in ("", person))
                for person, topic in written
            )
        }
        affected |= new
    return affected


def _topics(instance: str, way: str) -> tuple[AnyTopic, ...]:
    row = row_of(split_instance(instance)[0])
    return () if row is None else getattr(row, way)
