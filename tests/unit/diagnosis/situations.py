"""Broken situations of a site: the fault, the finding of doctor, and the step that it asks for."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from pointit.diagnosis.causes import unreachable
from pointit.diagnosis.diagnose import diagnose
from pointit.diagnosis.observation import Finding, StoppedProcess
from pointit.diagnosis.symptoms import ANCHOR_AGE, YAW_SIGMA
from pointit.runtime.link.link import ROUTER_LOST as LOST
from pointit.schemas import Figure
from pointit.schemas.problems import (
    CLOCK_LIMIT,
    DENIED,
    EVENT_LOOP,
    IDLE_ARM,
    INVALID,
    LATE,
    REVOKED,
    ROUTER_LOST,
    TWICE,
    UNWRITABLE,
    Problem,
)
from pointit.schemas.topics import CURSOR, IMU, RAY
from tests.unit.diagnosis.fault_sites import Process, Site, one_process, processes, router_with_people

AT = ("tcp/127.0.0.1:7447",)
SECURED = ("tls/hall:7447",)


@dataclass(frozen=True)
class Situation:
    """A fault, and what doctor is to say of it."""

    name: str
    make: Callable[[], Site]
    """Returns the healthy site."""
    break_it: Callable[[Site], object]
    """Breaks the site, or returns the finding of an observer that is outside."""
    code: str
    subject: str
    """Service of the finding, or `""`."""
    step: str
    """Text of the finding that tells what to do, of which the fault is mended."""
    words: str = ""
    """Further text of the sentence that names the cause."""
    is_outside: bool = False
    claims: int = 0
    """Number of findings about one person's claims that may stand beside it."""

    def findings(self) -> list[Finding]:
        site = self.make()
        result = self.break_it(site)
        if isinstance(result, Finding):
            return [result]
        return [each for each in diagnose(site.seen()) if not each.follows]


def outside(
    *, refused: bool = False, secured: bool = False, stopped: int = 0, rejection: str = ""
) -> Callable[[Site], Finding]:
    def finding(_site: Site) -> Finding:
        at = (StoppedProcess(stopped, ("pointit", "run")),) if stopped else ()
        return unreachable(
            SECURED if secured else AT, at, is_refused=refused, is_secured=secured, rejection=rejection
        )

    return finding


def tells(
    instance: str, code: str, sentence: str, subject: str = "", **fields: Any
) -> Callable[[Site], None]:
    """Return a fault that a service reports."""
    problem = Problem(code=code, sentence=sentence, subject=subject, **fields)

    def break_it(site: Site) -> None:
        if not any(instance in each.services for each in site.processes.values()):
            own = Process(70, "desk", (instance,), ("pointit", "service", "run"))
            site.processes[instance] = own
        site.warnings[instance] = (problem,)

    return break_it


def silent_wrist(code: str, sentence: str, severity: str = "warning") -> Callable[[Site], None]:
    """Return a wrist that has never sent anything, and says why."""

    def break_it(site: Site) -> None:
        run = site.processes["run"]
        rest = tuple(each for each in run.services if "user-sim" not in each)
        site.processes["run"] = replace(run, services=rest)
        site.deployments.clear()
        tells("imu-bridge.user1", code, sentence, severity=severity)(site)
        for reader in ("pointing", "localizer", "supervisor"):
            site.ages_s[f"{reader}.user1", IMU, "in"] = None
        site.ages_s["localizer.user1", RAY, "in"] = None

    return break_it


def ends(name: str, **options: bool) -> Callable[[Site], None]:
    return lambda site: site.end(name, **options)


def stops(name: str, *, is_local: bool = True) -> Callable[[Site], None]:
    return lambda site: site.stop(name, is_local=is_local)


def changes(name: str, **fields: Any) -> Callable[[Site], None]:
    def break_it(site: Site) -> None:
        site.processes[name] = replace(site.processes[name], **fields)

    return break_it


def observes(*, empties: bool = True, **options: Any) -> Callable[[Site], None]:
    def break_it(site: Site) -> None:
        if empties:
            site.processes.clear()
            site.deployments.clear()
        site.options.update(options)

    return break_it


def both(*faults: Callable[[Site], object]) -> Callable[[Site], None]:
    def break_it(site: Site) -> None:
        for each in faults:
            each(site)

    return break_it


def only_router(site: Site) -> None:
    site.processes = {"router": site.processes["router"]}
    site.deployments.clear()


def full_disk(site: Site) -> None:
    full = "/state/{} cannot be {} ({}); later ones are lost: make room there"
    for service, file, verb, reason in (
        ("keeper", "states", "written", "database or disk is full"),
        ("selector", "journal.sqlite", "used", "disk I/O error"),
    ):
        sentence = full.format(file, verb, reason)
        site.warnings[service] = (Problem(code=UNWRITABLE, sentence=sentence, subject=file),)


def twice(site: Site) -> None:
    first = site.processes["pui"]
    site.processes["second"] = replace(first, pid=99)
    sentence = "pui runs twice: here and as process 99 on desk; end one of the two"
    site.warnings["pui"] = (Problem(code=TWICE, sentence=sentence, subject="process 99 on desk"),)


def invalid(site: Site) -> None:
    sentence = "300 messages were dropped, the last of user1 (orientation_xyzw: not of length 1)"
    for reader in ("pointing.user1", "localizer.user1"):
        site.invalid[reader, IMU] = 50
        site.warnings[reader] = (Problem(code=INVALID, sentence=sentence, topic=IMU.key, subject="user1"),)


def late_rays(site: Site) -> None:
    sentence = "40 messages on users/*/ray came later than others before them: check the link to their writer"
    site.warnings["pui"] = (Problem(code=LATE, sentence=sentence, topic=RAY.key),)
    site.ages_s["pui", RAY, "in"] = 1.2


def starved(site: Site) -> None:
    changes("pui", latency_s=0.4, period_s=1.6)(site)
    site.ages_s["selector", CURSOR, "in"] = 1.2


def revoked(site: Site) -> None:
    site.end("anna")
    sentence = (
        "hall/anna may not write users/anna/imu: refused, as it was revoked or its certificate replaced; end "
        "its processes, or make it valid with `pointit site renew anna`, copy its folder there again, and "
        "restart them"
    )
    site.warnings["router"] = (Problem(code=REVOKED, sentence=sentence, subject="anna"),)


def lost_router(site: Site) -> None:
    lost = Problem(code=ROUTER_LOST, sentence=LOST.format(where=AT[0], ago_s=7.0), subject=AT[0])
    site.processes = {"web": Process(7, "desk", ("web",), ("pointit", "dashboard"), warnings=(lost,))}


def forged(code: str, subject: str) -> Callable[[Site], None]:
    """Return a lie of ben's services beside a real outage of the site."""
    return both(stops("site"), changes("ben", warnings=(lie(code, subject),)))


def lie(code: str, subject: str) -> Problem:
    return Problem(code=code, sentence="forged; look elsewhere", subject=subject)


def uncertain(**figures: float) -> Callable[[Site], None]:
    names = {"yaw": YAW_SIGMA, "age": ANCHOR_AGE}

    def break_it(site: Site) -> None:
        site.figures["localizer.user1"] = tuple(
            Figure(name=names[name], value=value) for name, value in figures.items()
        )

    return break_it


def blocks(who: str) -> Callable[[Site], None]:
    sentence = (
        f"{who} has blocked the event loop for 4.2 s at x.py:3 in read: end what floods it, or report this"
    )

    def break_it(site: Site) -> None:
        tells("selector", EVENT_LOOP, sentence, who)(site)
        changes("run", latency_s=0.8)(site)
        site.ages_s["pointing.user1", IMU, "in"] = 4.0

    return break_it


HA = "home-assistant"
SITUATIONS: tuple[Situation, ...] = (
    Situation(
        "nothing runs",
        one_process,
        outside(refused=True),
        "unreachable",
        "",
        "start `pointit run`",
        is_outside=True,
    ),
    Situation(
        "the run is stopped (Ctrl-Z)",
        one_process,
        outside(stopped=10),
        "stopped",
        "",
        "kill -CONT 10",
        is_outside=True,
    ),
    Situation(
        "the router's machine is off",
        one_process,
        outside(),
        "unreachable",
        "",
        "start it again where it ran",
        is_outside=True,
    ),
    Situation(
        "the router of a secured site does not run",
        router_with_people,
        outside(refused=True, secured=True),
        "unreachable",
        "",
        "start its router with `pointit router`",
        is_outside=True,
    ),
    Situation(
        "secured site, no credentials",
        router_with_people,
        outside(
            rejection="the router at tcp/hall:7447 is of a secured site: give your identity by "
            "--credentials FOLDER"
        ),
        "denied",
        "",
        "--credentials",
        is_outside=True,
    ),
    Situation(
        "the certificate has expired",
        router_with_people,
        outside(
            secured=True,
            rejection="the router at tls/hall:7447 refuses anna's certificate: it has "
            "expired or is not valid yet, by the router's clock; renew it with `pointit site "
            "renew anna`",
        ),
        "denied",
        "",
        "`pointit site renew anna`",
        is_outside=True,
    ),
    Situation(
        "credentials of another site",
        router_with_people,
        outside(
            secured=True,
            rejection="the router at tls/hall:7447 is not the one of site lab: another "
            "authority certified it; use that site's credentials, or the right address",
        ),
        "denied",
        "",
        "use that site's credentials",
        is_outside=True,
    ),
    Situation("wrong `--site`", one_process, observes(other_sites=("hall",)), "empty", "", "--site hall"),
    Situation("the router answers, nothing else runs", one_process, observes(), "empty", "", "`pointit run`"),
    Situation(
        "only the router of a secured site runs",
        router_with_people,
        only_router,
        "empty",
        "",
        "`pointit run --site-only",
    ),
    Situation(
        "the observer's identity is revoked",
        router_with_people,
        observes(
            denied="this identity (anna) may do nothing here: it was revoked or its certificate "
            "replaced; copy the folder here again, or make one with `pointit site renew anna`"
        ),
        "denied",
        "",
        "`pointit site renew anna`",
    ),
    Situation(
        "a person's identity is revoked while they point",
        router_with_people,
        revoked,
        "denied",
        "router",
        "`pointit site renew anna`",
        "as it was revoked",
    ),
    Situation(
        "a process uses another person's identity",
        router_with_people,
        tells("router", DENIED, "hall/cleo may not write users/ben/ray (200 times): refused", "cleo"),
        "denied",
        "router",
        "its own credentials instead of those of cleo",
    ),
    Situation(
        "a process comes without credentials",
        router_with_people,
        tells("router", DENIED, "somebody was not let in: came without credentials, by plain TCP"),
        "denied",
        "router",
        "--credentials",
    ),
    *(
        Situation(
            f"`{name}` is killed (`--processes`)",
            processes,
            ends(name),
            "absent",
            name,
            f"pointit service run {name.partition('.')[0]}",
        )
        for name in (
            "pui",
            "selector",
            "keeper",
            "led-driver",
            "pointing.user1",
            "localizer.user1",
            "supervisor.user1",
        )
    ),
    Situation(
        "a person's process has ended",
        router_with_people,
        ends("anna"),
        "absent",
        "anna",
        "`pointit person add anna",
    ),
    Situation(
        "the shared services have ended",
        router_with_people,
        ends("site", with_its_deployment=True),
        "no-cursor",
        "",
        "`pointit run --site-only",
    ),
    Situation("`pui` is stopped", processes, stops("pui"), "stopped", "pui", "kill -CONT 20"),
    Situation(
        "the shared services are stopped", router_with_people, stops("site"), "stopped", "", "kill -CONT 2"
    ),
    Situation(
        "a person's process is stopped on their machine",
        router_with_people,
        stops("anna", is_local=False),
        "absent",
        "anna",
        "kill -CONT",
    ),
    Situation(
        "a person's process hangs",
        router_with_people,
        changes("anna", silence_s=4.0),
        "silent",
        "anna",
        "kill -CONT 3",
    ),
    Situation(
        "the device on the wrist is not plugged in",
        one_process,
        silent_wrist("port", "/dev/ttyUSB7 is not there: plug the device in"),
        "warning",
        "imu-bridge.user1",
        "plug the device in",
    ),
    Situation(
        "a wrist by UDP does not send",
        one_process,
        silent_wrist(
            "silent",
            "no reading arrives at UDP port 127.0.0.1:9999: start the app and let it send "
            "to this machine; only this machine is heard there: --set "
            "imu-bridge.udp.host=0.0.0.0 for others",
        ),
        "warning",
        "imu-bridge.user1",
        "--set imu-bridge.udp.host=0.0.0.0",
    ),
    Situation(
        "`--imu page`: nobody has taken the arm",
        one_process,
        silent_wrist(
            IDLE_ARM, "nobody moves the arm of user1 yet: take it in the page by mouse or phone", "note"
        ),
        "idle",
        "imu-bridge.user1",
        "take it in the page",
    ),
    Situation("a process gets too little processor time", processes, starved, "starved", "pui", "`top`"),
    Situation(
        "a plug-in blocks the event loop",
        one_process,
        blocks("method 'slow' of strangers"),
        "warning",
        "selector",
        "end what floods it",
        "process 10 of machine desk",
    ),
    Situation(
        "Home Assistant floods the run",
        one_process,
        blocks(HA),
        "warning",
        "selector",
        "end what floods it",
        HA,
    ),
    Situation("the disk is full", router_with_people, full_disk, "disk", "selector", "make room there"),
    Situation(
        "a machine's clock is wrong",
        router_with_people,
        changes("anna", ahead_s=-3.0),
        "clock",
        "localizer.anna",
        "synchronize",
        "laptop-anna",
    ),
    Situation(
        "the observer's own clock is wrong",
        router_with_people,
        lambda site: (
            [changes(name, ahead_s=-2.0)(site) for name in site.processes]
            and site.options.update(host="tablet")
        ),
        "clock",
        "",
        "synchronize",
    ),
    Situation("`pui` runs twice", processes, twice, "twice", "pui", "end all but one"),
    Situation(
        "a wrist's driver sends invalid messages",
        one_process,
        invalid,
        "failing",
        "pointing.user1",
        "pointit --version",
        "were invalid",
    ),
    Situation("a slow link to a person", router_with_people, late_rays, "warning", "pui", "check the link"),
    Situation(
        "Home Assistant is off",
        one_process,
        tells(
            HA,
            "connection",
            "no Home Assistant answers at http://ha:8123 (refused): start it, or correct "
            "`url`, its usual port is 8123",
        ),
        "warning",
        HA,
        "start it",
    ),
    Situation(
        "Home Assistant accepts the token and says nothing",
        one_process,
        tells(
            HA, "connection", "http://ha:8123 accepts the token and then says nothing: restart Home Assistant"
        ),
        "warning",
        HA,
        "restart Home Assistant",
    ),
    Situation(
        "an entity was renamed",
        one_process,
        tells(
            HA,
            "entities",
            "not in Home Assistant: light.desk (did you mean light.table?); correct "
            "`home_assistant` in the map or site",
        ),
        "warning",
        HA,
        "correct `home_assistant`",
    ),
    Situation(
        "the map's things are not connected",
        one_process,
        observes(empties=False, home_things=("desk",)),
        "no-bridge",
        "",
        "--with home-assistant",
    ),
    Situation(
        "the host of a light is unknown",
        one_process,
        tells(
            "led-driver",
            "network",
            "wled.local: no machine of this name is in the network: correct it, or switch the controller on",
        ),
        "warning",
        "led-driver",
        "correct it",
    ),
    Situation(
        "a person's yaw is uncertain",
        one_process,
        uncertain(yaw=60.0, age=60.0),
        "unsure",
        "localizer.user1",
        "`pointit person anchor user1`",
    ),
    Situation(
        "a person's yaw was corrected long ago",
        one_process,
        uncertain(age=400.0),
        "old-anchor",
        "localizer.user1",
        "`pointit person anchor user1`",
    ),
    Situation(
        "the battery of a wrist is low",
        one_process,
        tells("imu-bridge.user1", "battery", "the battery of the wrist is at 5 %; charge it"),
        "warning",
        "imu-bridge.user1",
        "charge it",
    ),
    Situation(
        "a dashboard has lost the router",
        one_process,
        lost_router,
        "unreachable",
        "",
        "start it again where it ran",
    ),
    Situation(
        "the shared services are stopped, and a person says that the router is lost",
        router_with_people,
        forged(ROUTER_LOST, "tls/evil.example:7447"),
        "stopped",
        "",
        "kill -CONT 2",
        claims=1,
    ),
    Situation(
        "the shared services are stopped, and a person says that a clock is wrong",
        router_with_people,
        forged(CLOCK_LIMIT, "desk"),
        "stopped",
        "",
        "kill -CONT 2",
        claims=1,
    ),
)
