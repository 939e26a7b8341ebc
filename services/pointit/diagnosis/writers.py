"""Writers of a topic, as far as presence shows. Pure."""

from collections.abc import Collection, Iterable

from pointit.runtime.bus.contract import AnyTopic
from pointit.runtime.config.nearest_name import did_you_mean
from pointit.schemas.system import split_instance
from pointit.schemas.table_types import NAME
from pointit.schemas.topics import ACCOUNTS, ANY
from pointit.services.registry import PROCESSES, Process, person_of


def row_of(service: str) -> Process | None:
    """Return the row of a service in the process table, or None."""
    return next((row for row in PROCESSES if row.name == service), None)


def is_bridge(instance: str) -> bool:
    """Return True if an instance is a bridge to a foreign system."""
    row = row_of(split_instance(instance)[0])
    return row is not None and row.room == "bridges"


def start_command(service: str, which: str = "") -> str:
    """Return the command that starts `service`, or `""` if the process table has none of that scope.

    Names come from other machines. Only a name of the table and a name that is valid in a key become part of
    a command. `which`: whose it is, or its name among several.
    """
    row = row_of(service)
    if row is None or ((row.scope == "user") != bool(which) and not row.several):
        return ""
    if which and (not NAME.match(which) or which.startswith(".")):
        return ""
    option = "--user" if row.scope == "user" else "--name"
    people = " --people [...]" if which and row.shard_serves is not None else ""
    return f"pointit service run {service}" + (f" {option} {which}{people}" if which else "")


def restart_remedy(instance: str, options: str) -> str:
    """Return the remedy that starts `instance`, if it should run at all. `options` join the site."""
    if instance.partition(".")[0].partition("-")[0] == "router":
        return "if it should run: pointit router --site-folder FOLDER"
    command = start_command(*split_instance(instance))
    return f"if it should run: {command}{options}" if command else "if it should run, start it where it ran"


def present_writers(topic: AnyTopic, name: str, present: Iterable[str]) -> list[str]:
    """Return the instances among `present` that may write `topic` at `name` (`*` or `""`: any)."""
    if topic in ACCOUNTS:
        return sorted(instance for instance in present if name in (ANY, "", instance))
    found: list[str] = []
    for instance in present:
        service, which = split_instance(instance)
        row = row_of(service)
        is_shard = bool(which) and row is not None and row.shard_serves is not None
        only = person_of(instance) if topic.placeholder == "user" else which
        other = topic.placeholder in ("user", service) and only and name not in (ANY, "", only)
        other = other or (is_shard and topic.placeholder != "user")  # its site's instance writes these
        writes = service in topic.writers or (row is not None and topic in row.writes)
        if writes and not other:
            found.append(instance)
    return sorted(found)


def silence_reason(topic: AnyTopic, name: str, present: Collection[str]) -> str:
    """Return a clause on the writers of `topic` at `name`, whether they run, and the remedy."""
    there = present_writers(topic, name, present)
    if there:
        return f"{', '.join(there)} can write it and runs; does `pointit doctor` find something wrong?"
    row = row_of(topic.writers[0])  # the first is the usual one
    if row is None:
        return f"it is written by {' or '.join(topic.writers)}"
    user = name if topic.placeholder == "user" and name not in (ANY, "") else ""
    command = f"pointit service run {row.name}" + (f" --user {user or 'NAME'}" if row.scope == "user" else "")
    near = did_you_mean(user, {other for other in map(person_of, present) if other} - {user})
    advice = f"{near[:-1]}, or start it with `{command}`?" if near else f"start it with `{command}`"
    return f"no writer is present ({' or '.join(topic.writers)}); {advice}"
