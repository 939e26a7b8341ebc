"""Findings about one service or person. Pure."""

from collections.abc import Sequence

from pointit.diagnosis.observation import Finding, Observation
from pointit.runtime.config.similar_names import did_you_mean
from pointit.schemas.system import split_instance


def is_about(instance: str, name: str) -> bool:
    """Return True if `name` is the instance, its service or its person."""
    return name in (instance, *split_instance(instance))


def filter_findings(findings: Sequence[Finding], seen: Observation, name: str) -> list[Finding]:
    """Return the findings about `name`, or one that nothing of that name runs or should run.

    Without the right to view the site, all findings are returned.
    """
    if seen.denied:
        return list(findings)
    instances = {*seen.present, *seen.left, *seen.expected}
    if not any(is_about(instance, name) for instance in instances):
        there = sorted({part for instance in instances for part in split_instance(instance) if part})
        return [
            Finding(
                severity="error",
                code="absent",
                service=name,
                sentence="does not run here",
                remedy=did_you_mean(name, there) or "start it, or see without --only what does",
            )
        ]
    return [each for each in findings if each.code == "unreachable" or is_about(each.service, name)]
