"""Broken situations of a site: its faults, and the finding of doctor."""

import socket
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Any

from pointit.diagnosis.causes import unreachable
from pointit.diagnosis.diagnose import diagnose
from pointit.diagnosis.observation import Finding, StoppedProcess
from pointit.diagnosis.symptoms import ANCHOR_AGE, YAW_SIGMA
from pointit.runtime.host.advised_commands import AdvisedCommands
from pointit.runtime.link.link import ROUTER_LOST as LOST
from pointit.schemas import Figure
from pointit.schemas.problems import (
    CLOCK_LIMIT,
    DENIED,
    EVENT_LOOP,
    HANDLER,
    IDLE_ARM,
    INVALID,
    LATE,
    REFUSED_ACTS,
    REVOKED,
    ROUTER_LOST,
    TWICE,
    UNWRITABLE,
    Problem,
)
from pointit.schemas.topics import CURSOR, IMU, RAY
from pointit.services.led_driver.output.udp_output import describe_network_error
from tests.unit.diagnosis.fault_sites import Process, Site, one_process, processes, router_with_people

AT = ("tcp/127.0.0.1:7447",)
SECURED = ("tls/hall:7447",)


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong, until somebody does what ends it."""

    kind: str
    """As in `remedies`."""
    of: str
    """Process, service, machine, person, file or option."""
    effect: Callable[[Site], object]
    """Changes the site, or returns the finding of an observer that is outside."""


@dataclass(frozen=True)
class Situation:
    """A site that is well but for its faults, and what doctor is to say of it."""

    name: str
    make: Callable[[], Site]
    """Returns the healthy site."""
    faults: tuple[Fault, ...]
    code: str
    subject: str = ""
    """Service of the finding, or `""`."""
    words: str = ""
    """Text of the sentence that names the cause."""
    claims: int = 0
    """Number of findings about one person's claims that may stand beside it."""

    def findings(self, ended: Collection[Fault] = ()) -> list[Finding]:
        """Return the findings of the site with those of its faults that are not `ended`."""
        site = self.make()
        for fault in self.faults:
            if fault not in ended and isinstance(finding := fault.effect(site), Finding):
                return [finding]
        return [each for each in diagnose(site.seen()) if not each.follows]


def outside(
    *, refused: bool = False, secured: bool = False, stopped: int = 0, rejection: str = ""
) -> Callable[[Site], Finding]:
    def finding(_site: Site) -> Finding:
        at = (StoppedProcess(stopped, ("pointit", "run")),) if stopped else ()
        return unreachable(
            SECURED if secured else AT,
            at,
            is_refused=refused,
            is_secured=secured,
            rejection=rejection,
            commands=AdvisedCommands(),
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


def ends(name: str, **options: bool) -> Fault:
    return Fault("ended", name, lambda site: site.end(name, **options))


def stops(name: str, *, is_local: bool = True) -> Fault:
    return Fault("stopped", name, lambda site: site.stop(name, is_local=is_local))


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


def failing_handler(site: Site) -> None:
    sentence = (
        "20 messages on users/*/cursor could not be handled, the last of anna (KeyNameError: led ''): "
        "end what writes them there, and report this with the log"
    )
    site.errors["led-driver"] = 20
    site.warnings["led-driver"] = (
        Problem(code=HANDLER, sentence=sentence, topic=CURSOR.key, subject="anna"),
    )


def late_rays(site: Site) -> None:
    sentence = "40 messages on users/*/ray arrived after newer ones: check the link to their writer"
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


def forged(code: str, subject: str) -> tuple[Fault, Fault]:
    """Return a real outage of the site and a lie of ben's services."""
    return stops("site"), Fault("lie", "ben", changes("ben", warnings=(lie(code, subject),)))


def lie(code: str, subject: str) -> Problem:
    return Problem(code=code, sentence="forged; look elsewhere", subject=subject)


def uncertain(**figures: float) -> Callable[[Site], None]:
    names = {"yaw": YAW_SIGMA, "age": ANCHOR_AGE}

    def break_it(site: Site) -> None:
        site.figures["localizer.user1"] = tuple(
            Figure(name=names[name], value=value) for name, value in figures.items()
        )

    return break_it


def blocks(who: str, remedy: str) -> Callable[[Site], None]:
    sentence = f"{who} has blocked the event loop for 4.2 s at x.py:3 in read: {remedy}"

    def break_it(site: Site) -> None:
        tells("selector", EVENT_LOOP, sentence, who)(site)
        changes("run", latency_s=0.8)(site)
        site.ages_s["pointing.user1", IMU, "in"] = 4.0

    return break_it


def own_clock(site: Site) -> None:
    for name in site.processes:
        changes(name, ahead_s=-2.0)(site)
    site.options["host"] = "tablet"


HA = "home-assistant"
WRIST = "imu-bridge.user1"
NO_CREDENTIALS = (
    "the router at tcp/hall:7447 is of a secured site: give your identity by --credentials FOLDER"
)
EXPIRED = (
    "the router at tls/hall:7447 refuses anna's certificate: it has expired or is not valid yet, by the "
    "router's clock; renew it with `pointit site renew anna`"
)
OTHER_SITE = (
    "the router at tls/hall:7447 is not the one of site lab: another authority certified it; use that site's "
    "credentials, or the right address"
)
UNKNOWN = (
    "this identity (anna) may do nothing here: it was revoked or its certificate replaced; copy the folder "
    "here again, or make one with `pointit site renew anna`"
)
FOREIGN = "hall/cleo may not write users/ben/ray (200 times): refused"
BARE = "a connection was refused: came without credentials, by plain TCP"
NO_UDP = (
    "no reading arrives at UDP port 127.0.0.1:9999: start the app and let it send to this machine; only this "
    "machine is heard there: --set imu-bridge.udp.host=0.0.0.0 for others"
)
NO_ARM = "nobody moves the arm of user1 yet: take it in the page by mouse or phone"
NO_HOME = (
    "no Home Assistant answers at http://ha:8123 (refused): start it, or correct `url`, its usual port is "
    "8123"
)
MUTE_HOME = "http://ha:8123 accepts the token but then does not answer: restart Home Assistant"
NO_BROKER = "acts on radio are refused: hall: the broker cannot be reached: start it, or correct its address"
CARRIER = "lamp-12cc87ef"
KILLED_CARRIER = f"acts on radio are refused: {CARRIER} has ended: start it again"
RENAMED = (
    "not in Home Assistant: light.desk (did you mean light.table?); correct `home_assistant` in the map or "
    "site"
)
NO_HOST = f"wled.local: {describe_network_error(socket.gaierror())}"
NO_PORT = "/dev/ttyUSB7 is not there: plug the device in"
LOW = "the battery of the wrist is at 5 %; charge it"
KILLED = (
    "pui", "selector", "keeper", "led-driver", "pointing.user1", "localizer.user1", "supervisor.user1",
)  # fmt: skip

# fmt: off
SITUATIONS: tuple[Situation, ...] = (
    Situation("nothing runs", one_process, (Fault("ended", "run", outside(refused=True)),), "unreachable"),
    Situation("the run is stopped (Ctrl-Z)", one_process,
              (Fault("stopped", "run", outside(stopped=10)),), "stopped"),
    Situation("the router's machine is off", one_process, (Fault("ended", "run", outside()),), "unreachable"),
    Situation("the router of a secured site does not run", router_with_people,
              (Fault("ended", "router", outside(refused=True, secured=True)),), "unreachable"),
    Situation("secured site, no credentials", router_with_people,
              (Fault("no identity", "hall", outside(rejection=NO_CREDENTIALS)),), "denied"),
    Situation("the certificate has expired", router_with_people,
              (Fault("identity", "anna", outside(secured=True, rejection=EXPIRED)),), "denied"),
    Situation("credentials of another site", router_with_people,
              (Fault("other site", "lab", outside(secured=True, rejection=OTHER_SITE)),), "denied"),
    Situation("wrong `--site`", one_process,
              (Fault("site", "hall", observes(other_sites=("hall",))),), "empty"),
    Situation("the router answers, nothing else runs", one_process,
              (Fault("ended", "run", observes()),), "empty"),
    Situation("only the router of a secured site runs", router_with_people,
              tuple(ends(each, with_its_deployment=True) for each in ("site", "anna", "ben", "cleo")),
              "empty"),
    Situation("the observer's identity is revoked", router_with_people,
              (Fault("identity", "anna", observes(denied=UNKNOWN)),), "denied"),
    Situation("a person's identity is revoked while they point", router_with_people,
              (Fault("identity", "anna", revoked),), "denied", "router", "as it was revoked"),
    Situation("a process uses another person's identity", router_with_people,
              (Fault("foreign identity", "cleo", tells("router", DENIED, FOREIGN, "cleo")),),
              "denied", "router"),
    Situation("a process comes without credentials", router_with_people,
              (Fault("bare process", "router", tells("router", DENIED, BARE)),), "denied", "router"),
    *(Situation(f"`{each}` is killed (`--processes`)", processes, (ends(each),), "absent", each)
      for each in KILLED),
    Situation("a person's process has ended", router_with_people, (ends("anna"),), "absent", "anna"),
    Situation("the shared services have ended", router_with_people,
              (ends("site", with_its_deployment=True),), "no-cursor"),
    Situation("`pui` is stopped", processes, (stops("pui"),), "stopped", "pui"),
    Situation("the shared services are stopped", router_with_people, (stops("site"),), "stopped"),
    Situation("a person's process is stopped on their machine", router_with_people,
              (stops("anna", is_local=False),), "absent", "anna"),
    Situation("a person's process hangs", router_with_people,
              (Fault("stopped", "anna", changes("anna", silence_s=4.0)),), "silent", "anna"),
    Situation("the device on the wrist is not plugged in", one_process,
              (Fault("no device", "/dev/ttyUSB7", silent_wrist("port", NO_PORT)),), "warning", WRIST),
    Situation("a wrist by UDP does not send", one_process,
              (Fault("setting", "imu-bridge.udp.host=0.0.0.0", silent_wrist("silent", NO_UDP)),),
              "warning", WRIST),
    Situation("`--imu page`: nobody has taken the arm", one_process,
              (Fault("idle arm", "user1", silent_wrist(IDLE_ARM, NO_ARM, "note")),), "idle", WRIST),
    Situation("a process gets too little processor time", processes, (Fault("load", "desk", starved),),
              "starved", "pui"),
    Situation("a plug-in blocks the event loop", one_process,
              (Fault("blocking call", "strangers",
                     blocks("method 'slow' of strangers", "it must call what blocks in a thread")),),
              "warning", "selector", "process 10 of machine desk"),
    Situation("Home Assistant floods the run", one_process,
              (Fault("flood", HA, blocks(HA, "report this place")),),
              "warning", "selector", HA),
    Situation("the disk is full", router_with_people, (Fault("full disk", "/state", full_disk),),
              "disk", "selector"),
    Situation("a machine's clock is wrong", router_with_people,
              (Fault("clock", "laptop-anna", changes("anna", ahead_s=-3.0)),), "clock", "localizer.anna"),
    Situation("the observer's own clock is wrong", router_with_people, (Fault("clock", "tablet", own_clock),),
              "clock"),
    Situation("`pui` runs twice", processes, (Fault("second process", "pui", twice),), "twice", "pui"),
    Situation("a wrist's driver sends invalid messages", one_process, (Fault("version", "user1", invalid),),
              "failing", "pointing.user1", "were invalid"),
    Situation("a service fails on one person's messages", one_process,
              (Fault("message", "anna", failing_handler),), "failing", "led-driver", "the last of anna"),
    Situation("a slow link to a person", router_with_people, (Fault("slow link", "users/*/ray", late_rays),),
              "warning", "pui"),
    Situation("Home Assistant is off", one_process, (Fault("ended", HA, tells(HA, "connection", NO_HOME)),),
              "warning", HA),
    Situation("Home Assistant accepts the token and says nothing", one_process,
              (Fault("mute", HA, tells(HA, "connection", MUTE_HOME)),), "warning", HA),
    Situation("an entity was renamed", one_process,
              (Fault("entity", "light.desk", tells(HA, "entities", RENAMED)),), "warning", HA),
    Situation("the map's things are not connected", one_process,
              (Fault("no bridge", "desk", observes(empties=False, home_things=("desk",))),), "no-bridge"),
    Situation("the broker of `--mqtt` is off", one_process,
              (Fault("no broker", "hall", tells("selector", REFUSED_ACTS, NO_BROKER, "mqtt")),),
              "warning", "selector"),
    Situation("a program with `@site.carries` was killed", one_process,
              (Fault("killed carrier", CARRIER, tells("selector", REFUSED_ACTS, KILLED_CARRIER, CARRIER)),),
              "warning", "selector"),
    Situation("the host of a light is unknown", one_process,
              (Fault("controller", "wled.local", tells("led-driver", "network", NO_HOST)),),
              "warning", "led-driver"),
    Situation("a person's yaw is uncertain", one_process,
              (Fault("pose", "user1", uncertain(yaw=60.0, age=60.0)),), "unsure", "localizer.user1"),
    Situation("a person's yaw was corrected long ago", one_process,
              (Fault("pose", "user1", uncertain(age=400.0)),), "old-anchor", "localizer.user1"),
    Situation("the battery of a wrist is low", one_process,
              (Fault("battery", WRIST, tells(WRIST, "battery", LOW)),), "warning", WRIST),
    Situation("a dashboard has lost the router", one_process, (Fault("ended", "run", lost_router),),
              "unreachable"),
    Situation("the shared services are stopped, and a person says that the router is lost",
              router_with_people, forged(ROUTER_LOST, "tls/evil.example:7447"), "stopped", claims=1),
    Situation("the shared services are stopped, and a person says that a clock is wrong",
              router_with_people, forged(CLOCK_LIMIT, "desk"), "stopped", claims=1),
)
# fmt: on
