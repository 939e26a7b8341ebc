"""Sentences of doctor: no placeholder is left, and each `--set` can be typed as it is."""

from collections.abc import Iterator

import pytest

from pointit.diagnosis.diagnose import diagnose
from pointit.schemas.problems import CODES, Problem
from pointit.schemas.topics import TOPICS
from tests.unit.diagnosis.fault_sites import READS, Site, one_process, router_with_people
from tests.unit.diagnosis.remedies import check_sentence


def sites() -> Iterator[str]:
    """Yield every text that doctor shows of each code, topic and writer."""
    for make, instances in (
        (one_process, ("pointing.user1",)),
        (router_with_people, ("pui", "pointing.anna")),
    ):
        for instance in instances:
            for code in CODES:
                site = make()
                site.warnings[instance] = tuple(
                    Problem(code=code, sentence="told", subject="subject", topic=topic.key)
                    for topic in TOPICS[::3]
                )
                yield from rendered(site)
        for topic in {each for topics in READS.values() for each in topics}:
            for age_s in (None, 20.0):
                site = make()
                for service, reads in READS.items():
                    for each in site.seen().present:
                        if each.partition(".")[0] == service and topic in reads:
                            site.ages_s[each, topic, "in"] = age_s
                            site.invalid[each, topic] = 3
                yield from rendered(site)


def rendered(site: Site) -> Iterator[str]:
    for each in diagnose(site.seen()):
        yield f"{each.service} {each.sentence} {each.remedy}"


def test_no_finding_has_a_placeholder() -> None:
    count = 0
    for count, text in enumerate(sites(), 1):  # noqa: B007
        check_sentence(text)
    assert count > 200


def test_a_placeholder_and_a_wrong_option_are_noticed() -> None:
    for wrong in (
        "its input users/{user}/imu",
        "try --set udp.host=0.0.0.0",
        "--set imu-bridge.udp.port=PORT",
    ):
        with pytest.raises(Exception, match=r"udp|user"):
            check_sentence(wrong)
