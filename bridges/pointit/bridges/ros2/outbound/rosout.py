"""What goes wrong, and when it is over, as lines of ROS's log: what `pointit doctor` finds in a report."""

import collections
import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from pointit.bridges.ros2.outbound import values
from pointit.bridges.ros2.routing.route_types import ConversionContext, Converted
from pointit.diagnosis.diagnose import diagnose
from pointit.diagnosis.observation import Observation, Report
from pointit.schemas import Health

INFO, WARN, ERROR = 20, 30, 40
"""Levels of rcl_interfaces/Log."""
LEVELS = {"warning": WARN, "error": ERROR}
"""By a finding's severity; notes are about the past and not told."""

OVER_REPORTS = 5
"""What so many reports in a row, one a second, no longer say is over: what flaps is told once."""
MOST_AT_ONCE = 16
"""Lines of one service that are told at once; what is new beyond them waits for its turn."""
REPORTS_PER_LINE = 5
"""After so many reports one more line of a service may be told."""
MOST_TOLD = 64
"""Of one service, that are not over; others wait until some are."""
MOST_SERVICES = 1000
"""Nobody has so many; of further ones nothing is told."""

LONG_S = 1e9
"""For how long we have looked on, for `diagnose`: who has restarted does not run twice."""

_NUMBER = re.compile(r"(?<!\w)\d+(?:[.,]\d+)*")

Line = tuple[int, str]
"""Level, and what is said."""


@dataclass(slots=True)
class _Told:
    """Something that has been said and is not over."""

    level: int
    missed: int = 0
    """Reports in a row that do not say it."""


@dataclass(slots=True)
class _Service:
    """What was said of one service."""

    name: str
    """Its instance, by the key of its reports."""
    spent: int = 0
    """Reports until as many lines as ever may be told at once."""
    last: Health | None = None
    told: dict[str, _Told] = field(default_factory=dict[str, _Told])
    """By sentence, as it was worded last."""

    def hear(self, health: Health) -> Iterator[Line]:
        """Yield what is over and what is new by this report."""
        self.spent = max(self.spent - 1, 0)
        now = _findings(self.name, health, self.last)
        self.last = health
        self._match(now)
        for sentence in [each for each, told in self.told.items() if told.missed >= OVER_REPORTS]:
            if self._may():
                del self.told[sentence]
                yield INFO, f"over: {sentence}"
        for sentence, level in now.items():
            told = self.told.get(sentence)
            has_room = len(self.told) < MOST_TOLD if told is None else level > told.level
            if has_room and self._may():
                self.told[sentence] = _Told(level)
                yield level, sentence

    def _match(self, now: dict[str, int]) -> None:
        """Count what is missing; what differs in numbers only, as do counts that grow, is the same."""
        anew: collections.defaultdict[str, list[str]] = collections.defaultdict(list)
        for sentence in now:
            if sentence not in self.told:
                anew[_NUMBER.sub("0", sentence)].append(sentence)
        for sentence in [each for each in self.told if each not in now]:
            worded = anew.get(_NUMBER.sub("0", sentence))
            if worded:
                self.told[worded.pop(0)] = self.told.pop(sentence)
            else:
                self.told[sentence].missed += 1
        for sentence in now:
            if sentence in self.told:
                self.told[sentence].missed = 0

    def _may(self) -> bool:
        """Return True if one more line may be told; if so it is counted."""
        if self.spent > (MOST_AT_ONCE - 1) * REPORTS_PER_LINE:
            return False
        self.spent += REPORTS_PER_LINE
        return True


class Rosout:
    """Tells of each service what is new and what is over, and nothing again."""

    def __init__(self) -> None:
        """Begin with nothing said."""
        self._services: dict[str, _Service] = {}
        self._gone: collections.OrderedDict[str, int] = collections.OrderedDict()
        """What services had spent that are gone: who starts and fails again and again says no more for it."""

    def __call__(self, health: Health, about: ConversionContext) -> Converted:
        """Return the lines to tell of one service by its report, none while nothing changes."""
        service = self._services.get(about.name)
        if service is None:
            if len(self._services) >= MOST_SERVICES:
                return ()
            spent = self._gone.pop(about.name, 0)
            service = self._services[about.name] = _Service(about.name, spent)
        types = about.scene.types
        stamp, name = values.time(types, about.stamp_ns), values.text(f"pointit.{about.name}")
        return tuple(
            types.make("rcl_interfaces/msg/Log", stamp=stamp, level=level, name=name, msg=values.text(said))
            for level, said in service.hear(health)
        )

    def forget(self, instance: str) -> None:
        """Forget what was said of a service that is gone."""
        service = self._services.pop(instance, None)
        if service is not None and service.spent:
            self._gone[instance] = service.spent
            if len(self._gone) > MOST_SERVICES:
                self._gone.popitem(last=False)

    def begin(self) -> None:
        """Begin anew: nobody has read before, so that all that is wrong now is new to who does."""
        self._services.clear()
        self._gone.clear()


def _findings(name: str, health: Health, before: Health | None) -> dict[str, int]:
    """Return the level of each sentence that is to be said of `name` by a report and the one `before` it."""
    reports = [Report(received_s=LONG_S, health=health)]
    if before is not None and (before.host, before.pid) == (health.host, health.pid):
        reports.insert(0, Report(received_s=LONG_S, health=before))
    seen = Observation(
        began_s=0.0,
        now_s=LONG_S,
        present=frozenset({name}),
        reports={name: reports},
    )
    found: dict[str, int] = {}
    for each in diagnose(seen):  # the worst first
        if each.service == name and each.severity in LEVELS:
            said = f"{each.sentence}; {each.remedy}" if each.remedy else each.sentence
            found.setdefault(values.text(said), LEVELS[each.severity])
    return found
