"""What was found about one service or person, out of all that was found; pure."""

from collections.abc import Sequence

from pointit.diagnosis.observation import Finding, Observation
from pointit.diagnosis.writers import split_instance


def is_about(instance: str, name: str) -> bool:
    """Return True if `name` is the instance, its service or its person."""
    return name in (instance, *split_instance(instance))


def filter_findings(findings: Sequence[Finding], seen: Observation, name: str) -> list[Finding]:
    """Return the findings about `name`; one more when nothing of that name runs or should run.

    Who may not look on knows neither, and gets them all.
    """
    if seen.denied:
        return list(findings)
    if not any(is_about(instance, name) for instance in {*seen.present, *seen.left, *seen.expected}):
        return [
            Finding(
                severity="error",
                code="absent",
                service=name,
                sentence="does not run here",
                remedy="start it, or see without --only what does",
            )
        ]
    return [finding for finding in findings if is_about(finding.service, name)]
