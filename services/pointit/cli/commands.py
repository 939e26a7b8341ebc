"""The tree of commands as data: names, a line each, and the location of those that run."""

from pointit.cli.common.installed_commands import LAB, of_package
from pointit.cli.common.lazy import Entry, command, noun

TOPIC = """See the messages of a running site, their rates, and what each topic carries.

Example: pointit topic list && pointit topic hz --all
"""

PERSON = """Add a person to a running site, and correct what differs from person to person.

USER is their name. A person's pose is found by pointing at lamps, or set by hand; drift and errors are
corrected by pointing at one lamp, or measured once.

Example: pointit person add anna --imu serial:/dev/ttyUSB0 --localize
"""

CALIBRATE = """Measure what differs from person to person, once; the result is stored.

First the mounting, if the sensor is worn differently from the configuration. Then the person, who must have
a known pose. --show prints the stored result and --erase deletes it.

Example: pointit person calibrate mounting anna && pointit person calibrate user anna
"""

ROBOT = """List the robots of a running site, and stop them.

People steer robots by pointing; see docs/how-to/robots.md.

Example: pointit robot list
"""

SERVICE = """List services, run one, or send a request to one that runs.

Example: pointit service run selector --help
"""

NEW = """Write a file of your own to begin with.

Example: pointit new room
"""

MAP = """Check, draw, fetch and list maps: positions of lamps, LED strips, belts and objects.

A map is a YAML file, also that of the ROS toolkit. MAP is the name of a shipped one (conveyor) or the
path of a file (./site.yaml). `pointit new room` writes one.

Example: pointit map check ./site.yaml && pointit map plot ./site.yaml -o site.svg
"""

PLUGIN = """List what can be plugged in, check that it works, or begin a plug-in of your own.

Plug-ins are devices, selection methods and services of this and of other packages.

Example: pointit plugin new imu-source my-wrist && pytest my-wrist
"""

SITE = """Manage who may join a site, and their rights.

A site's folder holds a small certificate authority, the router's files, and a folder for each identity.
Copy the latter to its machine and name it there by --credentials (or POINTIT_CREDENTIALS). A person may
write only under their own name; dashboards can only view. All others are rejected.

\b
Example:
  pointit site init lab --host 192.168.1.5 --users anna,ben
  pointit site router --site-folder lab
  pointit person add anna --credentials lab/identities/anna
"""

SITE_USER = """Add, remove and list the people of a site; the router follows within a second.

Example: pointit site user add carla --folder lab
"""

LEDS = """Test LED strips and how they are connected, and find where a moving head hangs.

Example: pointit leds test scenario_3 --leds ddp:wled-kitchen.local
"""

_ROUTER = command("router", "run a router that joins several machines", "pointit.cli.site.router:command")

COMMANDS: dict[str, tuple[Entry, ...]] = {
    "Start": (
        command(
            "run", "start a scenario: its services, simulated people, a live view", "pointit.cli.run.run:run"
        ),
        command(
            "dashboard",
            "open the page of a site that runs elsewhere, in the browser",
            "pointit.cli.run.dashboard:command",
        ),
        command("list", "list scenarios, maps, plug-ins and services", "pointit.cli.run.list:command"),
    ),
    "On a running site": (
        command(
            "doctor",
            "show what runs, what is stale, what is wrong and what to do",
            "pointit.cli.inspect.doctor:command",
        ),
        noun(
            "topic",
            "see messages, their rates and their fields",
            TOPIC,
            (
                command(
                    "list",
                    "show the topic table: keys, messages, rates, writers",
                    "pointit.cli.inspect.topics:command",
                ),
                command("echo", "print messages as they arrive", "pointit.cli.inspect.echo:command"),
                command("hz", "measure rates against the nominal ones", "pointit.cli.inspect.hz:command"),
                command(
                    "schema",
                    "show the fields of a message; write or check the catalogue",
                    "pointit.cli.inspect.schema:command",
                ),
            ),
        ),
        command(
            "track",
            "show trackers and objects: rates, latency, positions",
            "pointit.cli.inspect.track:command",
        ),
        command(
            "trace",
            "time a person's samples from capture to light, hop by hop",
            "pointit.cli.inspect.trace:command",
        ),
        noun(
            "person",
            "add a person, correct their pose, press their button",
            PERSON,
            (
                command("add", "add one person's services to a running site", "pointit.cli.run.user:command"),
                command("pose", "show or set a person's pose", "pointit.cli.people.pose:command"),
                command(
                    "anchor",
                    "point at one lamp to correct a person's pose",
                    "pointit.cli.people.anchor:command",
                ),
                noun(
                    "calibrate",
                    "measure a sensor's mounting, or a person's pointing offset",
                    CALIBRATE,
                    (
                        command(
                            "mounting",
                            "mounting of the sensor on the arm: two poses, arm level ahead and straight up",
                            "pointit.cli.people.calibrate_mounting:command",
                        ),
                        command(
                            "user",
                            "pointing offset of the person: pointing at lamps without a cursor",
                            "pointit.cli.people.calibrate_user:command",
                        ),
                    ),
                ),
                command(
                    "memory",
                    "show or erase what localizations found of a person's pointing",
                    "pointit.cli.people.memory:command",
                ),
                command("press", "press a person's button from here", "pointit.cli.people.press:command"),
            ),
        ),
        noun(
            "robot",
            "list robots: where they are, who steers them; stop them",
            ROBOT,
            (
                command(
                    "list",
                    "show where each robot is, who steers it, and why it stands",
                    "pointit.cli.inspect.robot:list_robots",
                ),
                command("stop", "stop one robot, some, or all", "pointit.cli.inspect.robot:stop"),
            ),
        ),
        noun(
            "service",
            "list services, run one, send a request to one",
            SERVICE,
            (
                command(
                    "list",
                    "list the services, and what they read and write",
                    "pointit.cli.run.list:list_services",
                ),
                command(
                    "run",
                    "run one service; its --help documents every parameter",
                    "pointit.cli.run.service:command",
                ),
                command(
                    "call",
                    "send a request to a service; without arguments, list requests",
                    "pointit.cli.inspect.call:command",
                ),
            ),
        ),
        command("metrics", "serve metrics of the site to Prometheus", "pointit.cli.inspect.metrics:command"),
        command(
            "audit", "show who selected what, when and how confidently", "pointit.cli.inspect.audit:command"
        ),
    ),
    "Record and replay": (
        command(
            "record",
            "record everything that travels on a site, in a file",
            "pointit.cli.recordings.record:command",
        ),
        command(
            "replay",
            "run the services of a recording again, and compare",
            "pointit.cli.recordings.replay:command",
        ),
        command("export", "write a recording as CSV tables", "pointit.cli.recordings.export:command"),
        command(
            "import",
            "make a recording of a CSV file or a ROS 2 bag",
            "pointit.cli.recordings.import_:command",
        ),
        command("page", "open a recording in the page, with a timeline", "pointit.cli.run.page:command"),
    ),
    "Rooms and devices of your own": (
        command(
            "devices",
            "find wrists and lights within reach, and the options that use them",
            "pointit.cli.plugins.devices:command",
        ),
        noun(
            "new",
            "write the map of a room of your own",
            NEW,
            (
                command(
                    "room",
                    "the map of a room with lamps and strips on its walls",
                    "pointit.cli.maps.new_room:command",
                ),
            ),
        ),
        noun(
            "map",
            "check, draw, fetch and list maps of rooms",
            MAP,
            (
                command("check", "show errors of a map, and what to do", "pointit.cli.maps.check:command"),
                command("plot", "draw a map from above: svg, png or pdf", "pointit.cli.maps.plot:command"),
                command(
                    "fetch",
                    "fetch a map from the parameters of a ROS 2 node",
                    "pointit.cli.maps.fetch:command",
                ),
                command("list", "list the shipped maps", "pointit.cli.run.list:list_maps"),
            ),
        ),
        noun(
            "leds",
            "test LED strips, find where a moving head hangs",
            LEDS,
            (
                command(
                    "calibrate",
                    "find the pose of a moving head by pointing its beam at known places",
                    "pointit.cli.run.leds_calibrate:command",
                ),
                command(
                    "test",
                    "light the pixels of each strip in turn, and say where the map has them",
                    "pointit.cli.run.leds_test:command",
                ),
            ),
        ),
        noun(
            "plugin",
            "list, check and begin what can be plugged in",
            PLUGIN,
            (
                command(
                    "new",
                    "write a package with a plug-in that works, and its tests",
                    "pointit.cli.plugins.new:command",
                ),
                command(
                    "check",
                    "check that plug-ins keep the promises of their kind",
                    "pointit.cli.plugins.check:command",
                ),
                command(
                    "list",
                    "list plug-ins, their packages, what is wrong",
                    "pointit.cli.run.list:list_plugins",
                ),
            ),
        ),
    ),
    "Several machines": (
        noun(
            "site",
            "manage who may join a site, and their rights",
            SITE,
            (
                command("init", "create a site: authority, router, identities", "pointit.cli.site.site:init"),
                command(
                    "show", "list identities, and when they expire", "pointit.cli.site.site:list_identities"
                ),
                noun(
                    "user",
                    "add, remove and list the people of a site",
                    SITE_USER,
                    (
                        command("add", "add people", "pointit.cli.site.site:add"),
                        command("remove", "remove people", "pointit.cli.site.site:remove"),
                        command("list", "list people", "pointit.cli.site.site:list_people"),
                    ),
                ),
                command("renew", "make new certificates", "pointit.cli.site.site:renew"),
                command("revoke", "revoke all rights of an identity", "pointit.cli.site.site:revoke"),
                _ROUTER,
            ),
        ),
        _ROUTER,
    ),
    "Measure": (
        of_package(LAB, "evaluate", "measure the accuracy of the estimates on recordings of people"),
        of_package(LAB, "load", "measure the number of people this machine, or a site, carries"),
    ),
    "Your shell": (
        command("completion", "install completion with the Tab key", "pointit.cli.shell.completion:command"),
    ),
}
"""Commands by the heading of the help."""

OLD_SPELLINGS = {
    "topics": ("topic", "list"),
    "echo": ("topic", "echo"),
    "hz": ("topic", "hz"),
    "schema": ("topic", "schema"),
    "user": ("person", "add"),
    "pose": ("person", "pose"),
    "anchor": ("person", "anchor"),
    "calibrate": ("person", "calibrate"),
    "press": ("person", "press"),
    "call": ("service", "call"),
}
"""First words of version 0.1, which are understood until the next version. `service NAME` is one, too."""
