"""The state of a site when its recording began, and how replayed services start from it."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pointit.recording.entries import Entry
from pointit.replay.levels import Split
from pointit.replay.room import write_room
from pointit.runtime.bus.contract import AnyTopic
from pointit.runtime.host.state_file import StateFile, site_folder
from pointit.schemas import (
    NS_PER_S,
    Environment,
    Interaction,
    Message,
    PointingOffset,
    Selection,
    SetPose,
    UserPose,
    UserProfile,
)
from pointit.schemas.topics import CONFIGURATION, INTERACTION, MAP, Delivery, Topic
from pointit.services.selector.outputs import Record
from pointit.services.selector.store.journal import Journal
from pointit.services.supervisor.readiness import LAST_WORD_PURPOSE
from pointit.services.supervisor.user_messages import OFFSET_PURPOSE

GATHERING_NS = 5 * NS_PER_S
"""Time after the beginning within which retained states reach a recorder, ns."""


@dataclass
class Beginning:
    """States and services that were there when the recording began."""

    retained: dict[str, Entry] = field(default_factory=dict[str, Entry])
    """By key: the first entry of each state that was older than the recording."""
    room: Environment | None = None
    instances: set[str] = field(default_factory=set[str])
    """Services with a configuration, now or later in the recording."""

    def states(self, split: Split, *, recomputed: bool) -> Iterator[tuple[AnyTopic, str, Message]]:
        """Yield topic, name and value of the states, either `recomputed` ones or those of the edge."""
        for entry in self.retained.values():
            row, body = entry.row, entry.body
            if not isinstance(row, Topic) or not isinstance(body, Message) or row is CONFIGURATION:
                continue
            if split.is_recomputed(entry) == recomputed:
                yield row, entry.name, body

    def restore(self, site: str, folder: Path) -> Path | None:
        """Write what the services of `site` read from disk into the state directory in use.

        Return the path of the map, written into `folder`, or None to use the configured one.
        """
        for entry in self.retained.values():
            if isinstance(entry.body, UserProfile) and entry.body.offset is not None:
                StateFile(PointingOffset, entry.name, OFFSET_PURPOSE).write(entry.body.offset)
            elif isinstance(entry.body, Selection):
                _restore_selection(entry.body, site, entry.time_ns)
        return None if self.room is None else write_room(self.room, folder)

    def restore_interaction(self, user: str, now_ns: int) -> None:
        """Write the interaction of `user`, so that a supervisor that starts at `now_ns` resumes it.

        A supervisor resumes pointing if its localizer is older than the interaction, and so must this one be.
        """
        entry = self.retained.get(INTERACTION.at(user))
        if entry is not None and isinstance(entry.body, Interaction):
            before = entry.body.model_copy(update={"stamp_ns": now_ns})
            StateFile(Interaction, user, LAST_WORD_PURPOSE).write(before)

    def measured_poses(self) -> Iterator[tuple[str, SetPose]]:
        """Yield the people whose localizers had found a pose, and the request that sets it."""
        for entry in self.retained.values():
            pose = entry.body
            if isinstance(pose, UserPose) and pose.method != "external" and any(pose.covariance):
                yield entry.name, SetPose.model_validate(pose, from_attributes=True)


def read_beginning(entries: Iterable[Entry], began_ns: int) -> Beginning:
    """Return the state at `began_ns`. `entries` are all those of states, in order."""
    beginning = Beginning()
    seen: set[str] = set()
    for entry in entries:
        row, body = entry.row, entry.body
        if row is CONFIGURATION:
            beginning.instances.add(entry.name)
        if entry.key in seen or not isinstance(row, Topic) or row.delivery is not Delivery.STATE:
            continue
        seen.add(entry.key)
        if row is MAP and isinstance(body, Environment):
            beginning.room = body
        is_early = entry.time_ns < began_ns + GATHERING_NS
        if is_early and isinstance(body, Message) and body.stamp_ns < began_ns:
            beginning.retained[entry.key] = entry
    return beginning


def _restore_selection(selection: Selection, site: str, now_ns: int) -> None:
    journal = Journal(site_folder(site, "selector"))
    journal.begin(now_ns)
    for number, each in enumerate(selection.objects, 1):
        journal.add(
            Record(
                each.since_ns,
                "selected",
                each.id,
                each.kind,
                user=each.user,
                owner=each.user,
                since_ns=each.since_ns,
                confidence=each.confidence,
                seq=number,
            )
        )
        journal.mark_published(number)
    journal.maintain(now_ns, is_selected=bool(selection.objects))
    journal.close()
