"""The tree of commands as data: names, a line each, and the location of those that run."""

from pointit.cli.common.lazy import LAB, LABORATORY, LazyEntry, command, noun, of_package

TOPIC = """See the messages of a running site, their rates, and what each topic carries.

Example: pointit topic list && pointit topic hz --all
"""

PERSON = """Add a person to a running site, and calibrate them.

USER is the person's name. Their pose is found by pointing at lamps, or is set by hand. Pointing at one lamp
corrects its drift. Errors of a person are measured once.

Example: pointit person add anna --imu serial:/dev/ttyUSB0 --localize
"""

CALIBRATE = """Measure a person's mounting and pointing offset once. The result is stored.

Measure the mounting first if the sensor is worn differently from the configuration. Then measure the offset,
for which the pose must be known. --show prints the stored result. --erase deletes it.

Example: pointit person calibrate mounting anna && pointit person calibrate user anna
"""

ROBOT = """List the robots of a running site, and stop them.

People steer robots by pointing; see docs/how-to/robots.md.

Example: pointit robot list
"""

THINGS = """List and try the things of a running site's map. They react when people point at them.

Example: pointit things list
"""

SERVICE = """List services, run one, or send a request to one that runs.

Example: pointit service run selector --help
"""

MAP = """Create, check, draw, fetch and list maps: positions of lamps, LED strips, belts and objects.

A map is a YAML file of PointIt or of the ROS toolkit. MAP is the name of a shipped map (conveyor) or the path
of a file (./site.yaml). `pointit map new` writes one.

Example: pointit map check ./site.yaml && pointit map plot ./site.yaml -o site.svg
"""

PLUGIN = """List plug-ins, check them, or start a plug-in of your own.

Plug-ins are devices, selection methods and services of this and of other packages.

Example: pointit plugin new imu-source my-wrist && pytest my-wrist
"""

SITE = """Manage the identities that may join a site, and their rights.

A site's folder holds a small certificate authority, the router's files, and a folder for each identity. Copy
an identity's folder to its machine and name it there by --credentials (or POINTIT_CREDENTIALS). A person may
write only under their own name; dashboards only view.

\b
Example:
  pointit site init lab --host 192.168.1.5 --users anna,ben
  pointit site router --site-folder lab
  pointit person add anna --credentials lab/identities/anna
"""

SITE_USER = """Add, remove and list the people of a site; the router follows within a second.

Example: pointit site user add carla --folder lab
"""

SITE_SERVICE = """Add identities with the rights of one service, not of all shared ones.

Example: pointit site service add foxglove --folder lab
"""

OUTPUT = """Test strips, add an output to a running site, and find where a moving head hangs.

Example: pointit output test scenario_3 --output ddp:wled-kitchen.local
"""

STUDY = """Run an experiment with people who point, check its data, analyse it.

A study is a YAML file. Its data are a folder of tables.

Example: pointit study run my_study.yaml --simulated 12
"""


def ours(name: str, about: str, place: str) -> LazyEntry:
    """Return a command of this package; `place` is its module, and `:attribute` unless that is `command`."""
    module, _, attribute = place.partition(":")
    return command(name, about, f"pointit.cli.{module}:{attribute or 'command'}")


_ROUTER = ours("router", "run a router that joins several machines", "router")

COMMANDS: dict[str, tuple[LazyEntry, ...]] = {
    "Start": (
        ours("run", "start a scenario: its services, simulated people, a live view", "run.run:run"),
        ours("home", "point at the lamps of your home, set up in the page", "home"),
        ours("dashboard", "open the page of a site on this or another machine", "page:dashboard"),
        ours("list", "list scenarios, maps, plug-ins and services", "inspect.listings"),
    ),
    "On a running site": (
        ours("doctor", "show services, outdated reports, problems and remedies", "inspect.doctor"),
        noun(
            "topic",
            "see messages, their rates and their fields",
            TOPIC,
            ours(
                "list", "show the topic table: keys, messages, rates, writers", "inspect.listings:list_topics"
            ),
            ours("echo", "print messages as they arrive", "inspect.topics:echo"),
            ours("hz", "measure rates against the nominal ones", "inspect.topics:hz"),
            ours("schema", "show the fields of a message; write or check the catalogue", "inspect.schema"),
        ),
        ours("listen", "follow a person's spoken commands", "things.listen"),
        ours("track", "show trackers and objects: rates, latency, positions", "inspect.track"),
        ours("trace", "time a person's samples from capture to light, hop by hop", "inspect.trace"),
        noun(
            "person",
            "add a person, correct their pose, press their button",
            PERSON,
            ours("add", "add one person's services to a running site", "run.user"),
            ours("pose", "show or set a person's pose", "people.pose"),
            ours("anchor", "point at one lamp to correct a person's pose", "people.anchor"),
            noun(
                "calibrate",
                "measure a sensor's mounting, or a person's pointing offset",
                CALIBRATE,
                ours(
                    "mounting", "mounting of the sensor on the arm, by two poses", "people.calibrate_mounting"
                ),
                ours("user", "pointing offset of the person, by pointing at lamps", "people.calibrate_user"),
            ),
            ours("press", "press a person's button from here", "people.press"),
        ),
        noun(
            "robot",
            "list robots with positions and users; stop them",
            ROBOT,
            ours("list", "show the position and the user of each robot", "robots:list_robots"),
            ours("stop", "stop one robot, some, or all", "robots:stop"),
        ),
        noun(
            "things",
            "list and try things that react to pointing",
            THINGS,
            ours("list", "list things: mode, light, how often they fired", "things.things:list_things"),
            ours("react", "start programs when people point at things", "things.things:react_to_things"),
            ours("try", "fire a thing without pointing at it", "things.things:try_thing"),
        ),
        noun(
            "service",
            "list services, run one, send a request to one",
            SERVICE,
            ours("list", "list the services with their topics", "inspect.listings:list_services"),
            ours("run", "run one service; its --help documents every parameter", "run.user:run_one_service"),
            ours("call", "send a request to a service; without arguments, list requests", "inspect.call"),
        ),
        ours("mcp", "serve a site to assistants, by the Model Context Protocol", "assistants"),
        ours("metrics", "serve metrics of the site to Prometheus", "inspect.metrics"),
        ours("audit", "show selections with person, object, time and confidence", "inspect.audit"),
    ),
    "Record and replay": (
        ours("record", "record all messages of a site in a file", "recordings.record"),
        ours("replay", "run the services of a recording again, and compare", "recordings.replay"),
        ours("export", "write a recording as CSV tables", "recordings.export:export"),
        ours("import", "make a recording of a CSV file or a ROS 2 bag", "recordings.import_"),
        ours("page", "open a recording in the page, with a timeline", "page"),
    ),
    "Rooms and devices of your own": (
        ours("devices", "find wrists, outputs and robots in reach, and their options", "plugins.devices"),
        noun(
            "map",
            "make, check, draw, fetch and list maps of rooms",
            MAP,
            ours("new", "write the map of a room of your own, with lamps and strips", "maps.map_file:new"),
            ours("check", "show errors of a map, with remedies", "maps.map_file:check"),
            ours("plot", "draw a map from above: svg, png or pdf", "maps.map_file"),
            ours("fetch", "fetch a map from the parameters of a ROS 2 node", "maps.fetch"),
            ours("scan", "map a room by a camera: its strips blink, a phone sees them", "maps.scan"),
            ours("point", "find lamps and boxes by pointing from two places", "maps.point"),
            ours("import", "make a map of a file of WLED or xLights", "maps.exchange:import_"),
            ours("export", "write the pixels of a map for WLED or xLights", "maps.exchange:export"),
            ours("list", "list the shipped maps", "inspect.listings:list_maps"),
        ),
        noun(
            "output",
            "test strips, add an output, find where a moving head hangs",
            OUTPUT,
            ours("add", "show strips of a running site on a further output", "outputs:add"),
            ours("calibrate", "find the pose of a moving head by its beam", "outputs:calibrate"),
            ours("test", "light the pixels of each strip in turn", "outputs"),
        ),
        noun(
            "plugin",
            "list, check and start plug-ins",
            PLUGIN,
            ours("new", "write a package with a working plug-in and its tests", "plugins.check:new"),
            ours("check", "check that plug-ins keep the promises of their kind", "plugins.check"),
            ours("list", "list plug-ins, their packages and problems", "inspect.listings:list_plugins"),
        ),
    ),
    "Several machines": (
        noun(
            "site",
            "manage the identities of a site, and their rights",
            SITE,
            ours("init", "create a site: authority, router, identities", "site:init"),
            ours("show", "list identities and their expiry", "site:list_identities"),
            noun(
                "user",
                "add, remove and list the people of a site",
                SITE_USER,
                ours("add", "add people", "site:add"),
                ours("remove", "remove people", "site:remove"),
                ours("list", "list people", "site:list_people"),
            ),
            noun(
                "service",
                "add identities that have the rights of one service",
                SITE_SERVICE,
                ours("add", "add services", "site:add_service"),
            ),
            ours("renew", "make new certificates", "site:renew"),
            ours("revoke", "revoke all rights of an identity", "site:revoke"),
            _ROUTER,
        ),
        _ROUTER,
    ),
    "Experiments": (
        noun(
            "study",
            "run an experiment, check and analyse its data",
            STUDY,
            ours("run", "run a study with people, or with simulated ones", "study"),
            ours("check", "find missing trials, wrong clocks, broken balance", "study:check"),
            ours("report", "report a study: a page and a notebook, with tables and figures", "study:report"),
            ours("power", "compute the number of participants for a stated effect", "study:power"),
        ),
    ),
    LABORATORY: (
        of_package(LAB, "evaluate", "measure the accuracy of the estimates on recordings of people"),
        of_package(LAB, "load", "measure the number of people that this machine or a site supports"),
    ),
    "Your shell": (ours("completion", "install completion with the Tab key", "shell"),),
}
"""Commands by the heading of the help."""
