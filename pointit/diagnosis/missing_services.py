"""Services that are missing, and people without a cursor because of them. Pure."""

from collections.abc import Iterator, Sequence

from pointit.diagnosis.observation import Finding, Observation, present_writers, restart_remedy, row_of
from pointit.runtime.bus.contract import AnyTopic
from pointit.schemas.environment import Environment
from pointit.schemas.system import RUN, split_instance
from pointit.schemas.topics import CURSOR, HOVER, IMU, MAP, RAY
from pointit.services.registry import HOME_ASSISTANT, person_of

CHAIN: tuple[AnyTopic, ...] = (IMU, RAY, CURSOR, HOVER)
"""Topics from a wrist to a selection. Each is made of the one before it."""
SHARED_REMEDY = (
    "start what all people share again where it ran, with `pointit run --site-only{credentials}`; if its "
    "process is stopped there, continue it: `kill -CONT PID`"
)
HOME_REMEDY = (
    f"add --with {HOME_ASSISTANT.name} to `pointit run`, and its address and token by --config "
    "(`home_assistant: {url, token_file}`)"
)
MAX_LISTED = 4
"""Number of names that a sentence lists."""
GONE = ("absent", "left", "silent")
"""Codes of findings of a service that does nothing."""


def find_missing(seen: Observation) -> Iterator[Finding]:
    """Find services that should run and do not, or do not report."""
    for instance, remedy in seen.expected.items():
        if instance not in seen.present and instance not in seen.starting:
            yield Finding("error", "absent", instance, "should run and does not", remedy)
    for instance in seen.left - seen.present - seen.expected.keys():
        sentence = "was present and has left: ended, killed, stopped or cut off"
        yield Finding(
            "warning", "left", instance, sentence, restart_remedy(instance, seen.options_of(instance))
        )
    for instance in filter(seen.is_silent, seen.present):
        health = seen.newest(instance)
        sentence = (
            f"is present but has not reported for {seen.silence_s(instance):.0f} s: is it stopped, "
            "overloaded or cut off?"
        )
        again = seen.expected.get(instance, restart_remedy(instance, seen.options_of(instance)))
        process = f"process {health.pid}" if health else "its process"
        remedy = f"look at {process} (stopped: `kill -CONT`); else {again}"
        yield Finding("error", "silent", instance, sentence, remedy)


def find_empty_site(seen: Observation) -> Iterator[Finding]:
    """Find a site where nothing runs, or that may not be viewed."""
    if seen.denied:
        yield Finding("error", "denied", "", seen.denied, "")
    elif not seen.present and not seen.expected and seen.other_sites:
        are = "a site is" if len(seen.other_sites) == 1 else "sites are"
        sentence = f"no service runs on this site, but {are} there: {', '.join(seen.other_sites)}"
        yield Finding("error", "empty", "", sentence, f"name the right one: --site {seen.other_sites[0]}")
    elif not seen.present and not seen.expected:
        remedy = (
            "start with `pointit run`, or name the right site with --site, or its address with --connect (of "
            "a run with --ros2: tcp/127.0.0.1:7448)"
        )
        yield Finding("error", "empty", "", "the router answers, but no service runs on this site", remedy)
    elif not seen.expected and all(map(is_router, seen.present)):
        remedy = (
            "start what all people share with `pointit run --site-only --credentials FOLDER/identities/"
            "supervisor`, then each person with `pointit person add NAME --credentials NAME`"
        )
        yield Finding("error", "empty", "", "nothing but the router runs on this site yet", remedy)


def find_people_without_cursor(seen: Observation) -> Iterator[Finding]:
    """Find people whose pointing has no effect, since a service that it needs is not present."""
    people = {
        person: services
        for person, services in _services_by_person(seen).items()
        if _missing_writers(seen, person, services)
    }
    if not people or is_anything_starting(seen):
        return
    lacking = {each for person in people for each in _missing_writers(seen, person, people[person])}
    names = sorted(people)
    without = "cursor" if lacking & {"pui", "pointing"} else "selections"
    have = f"has no {without}" if len(names) == 1 else f"have no {without}"
    run = "does not run" if len(lacking) == 1 else "do not run"
    sentence = f"{listed(names)} {have}: {listed(sorted(lacking))} {run} on this site"
    remedy = SHARED_REMEDY.format(credentials=seen.credentials_of("supervisor"))
    if lacking == {"pointing"}:
        pointing = f"pointing.{names[0]}"
        remedy = restart_remedy(pointing, seen.options_of(pointing))
    subject = names[0] if len(names) == 1 else ""
    user_services = sorted(each for services in people.values() for each in services)
    yield Finding(
        "error", "no-cursor", subject, sentence, remedy, services=(*sorted(lacking), *user_services)
    )


def find_missing_bridge(seen: Observation) -> Iterator[Finding]:
    """Find things that are entities of a Home Assistant on a site that is not connected to it."""
    services = {*seen.present, *seen.left, *seen.expected}
    is_map_in_use = bool(
        present_writers(MAP, "", seen.present)
    )  # a retained one may be of a run that is over
    if seen.home_things and is_map_in_use and HOME_ASSISTANT.name not in services:
        yield Finding("warning", "no-bridge", "", unconnected_sentence(seen.home_things), HOME_REMEDY)


def home_things(environment: Environment) -> tuple[str, ...]:
    """Return the names of the things that are entities of a Home Assistant."""
    return tuple(thing.id for thing in environment.things if thing.home_assistant)


def unconnected_sentence(things: Sequence[str]) -> str:
    """Return the sentence on things of a Home Assistant to which the site is not connected."""
    return f"Home Assistant is not connected: pointing at {listed(things)} switches nothing there"


def listed(names: Sequence[str]) -> str:
    """Return `a, b and c`, or of more than four `a, b, c and 3 more`."""
    if len(names) > MAX_LISTED:
        return f"{', '.join(names[: MAX_LISTED - 1])} and {len(names) - MAX_LISTED + 1} more"
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _missing_writers(seen: Observation, person: str, services: list[str]) -> set[str]:
    """Return the services that are not present and that `person`, who has `services`, needs for pointing."""
    written = [topic for topic in CHAIN if present_writers(topic, person, seen.present)]
    own = {topic for each in services for topic in _writes(each)}
    if not own & {IMU, RAY}:
        return set()
    needed = CHAIN[1:3] if _does_without_selector(seen, person) else CHAIN[1:]
    return {topic.writers[0] for topic in needed if topic not in written}


def _does_without_selector(seen: Observation, person: str) -> bool:
    """Return True if nothing is selected on the site: a run has no selector, or the person sends robots."""
    runs = [services for name, services in seen.services_of.items() if name.startswith(RUN)]
    is_run_without = bool(runs) and not any("selector" in services for services in runs)
    return is_run_without or f"goal.{person}" in seen.present


def _writes(instance: str) -> tuple[AnyTopic, ...]:
    row = row_of(split_instance(instance)[0])
    return () if row is None else row.writes


def _services_by_person(seen: Observation) -> dict[str, list[str]]:
    services: dict[str, list[str]] = {}
    for instance in sorted(seen.present):
        if person := person_of(instance):
            services.setdefault(person, []).append(instance)
    return services


def is_anything_starting(seen: Observation) -> bool:
    """Return True if a service that is missing, or has not reported yet, may be starting."""
    if not seen.is_patient:
        return False
    are_new = [
        all(map(seen.has_just_begun, services))
        for person, services in _services_by_person(seen).items()
        if _missing_writers(seen, person, services)
    ]
    return (bool(are_new) and all(are_new)) or not seen.starting <= seen.present & seen.reports.keys()


def is_router(instance: str) -> bool:
    """Return True if `instance` is a router's account of itself."""
    return instance.partition(".")[0].partition("-")[0] == "router"
