"""THE TOPIC TABLE: every key with its message, delivery, rate and writer.

Keys are relative to the site's namespace, `pointit/<site>`. A key has at most one placeholder, in braces.
No other module spells a key: services name the rows of this table.
"""

from typing import Any

from pointit.schemas import environment, home, person, pointing, requests, selection, system
from pointit.schemas.robots import ROBOT_PLAN, ROBOT_STATE, STEERING
from pointit.schemas.table_types import (
    ANY,
    MAX_AGE_PERIODS,
    NAME,
    Delivery,
    Presence,
    Request,
    Topic,
    check_name,
)

# tables: each row takes as few lines as it needs
# fmt: off
ADD_PACKAGE = Request(
    key="conveyor/add_package", query=requests.AddPackage, reply=requests.AddPackageReply,
    server="conveyor-sim", about="put one object on a lane",
)
SET_SPEED = Request(
    key="conveyor/set_speed", query=requests.SetSpeed, reply=requests.Done, server="conveyor-sim",
    about="set the speed, m/s",
)
SET_FEEDING = Request(
    key="conveyor/set_feeding", query=requests.SetFeeding, reply=requests.Done, server="conveyor-sim",
    about="start or stop the feeders",
)
RESET_CONVEYOR = Request(
    key="conveyor/reset", query=requests.ResetConveyor, reply=requests.Done, server="conveyor-sim",
    about="empty it and start the feeders again",
)
START_LOCALIZATION = Request(
    key="localizer/{user}/start", query=requests.StartLocalization, reply=requests.Done, server="localizer",
    about="begin to localize",
)
CANCEL_LOCALIZATION = Request(
    key="localizer/{user}/cancel", query=requests.CancelLocalization, reply=requests.Done, server="localizer",
    about="stop localizing",
)
SET_POSE = Request(
    key="localizer/{user}/set_pose", query=requests.SetPose, reply=requests.Done, server="localizer",
    about="say where the person stands",
)
SET_HEADING = Request(
    key="localizer/{user}/set_heading", query=requests.SetHeading, reply=requests.Done, server="localizer",
    about="the person points in a known direction: set the yaw",
)
POINT_ANCHOR = Request(
    key="localizer/{user}/point_anchor", query=requests.PointAnchor, reply=requests.Done, server="localizer",
    about="point at one lamp to set the pose right",
)
SET_OFFSET = Request(
    key="profile/{user}/set_offset", query=requests.SetOffset, reply=requests.Done, server="supervisor",
    about="keep or forget the person's pointing offset",
)
CLEAR_SELECTION = Request(
    key="selector/{user}/clear", query=requests.ClearSelection, reply=requests.Done, server="selector",
    about="deselect all that is the person's",
)
UNDO_SELECTION = Request(
    key="selector/{user}/undo", query=requests.UndoSelection, reply=requests.Done, server="selector",
    about="take back the person's last (de)selection",
)
RELEASE_OBJECT = Request(
    key="selector/{user}/release", query=requests.ReleaseObject, reply=requests.Done, server="selector",
    about="deselect or take over an object of any person: operators only",
)
SET_THING = Request(
    key="selector/{user}/set_thing", query=requests.SetThing, reply=requests.Done, server="selector",
    about="fire or switch a thing without pointing: operators only",
)
BEGIN_ACT = Request(
    key="acts/{carrier}/begin", query=requests.BeginAct, reply=requests.BeginActReply, server="selector",
    about="ask whether an act may begin: only the carrier of that name",
)
SET_WORKSPACE = Request(
    key="pui/{user}/set_workspace", query=requests.SetWorkspace, reply=requests.Done, server="pui",
    about="a surface about the person for their cursor",
)
SET_METHOD = Request(
    key="selector/method", query=requests.SetMethod, reply=requests.SetMethodReply, server="selector",
    about="how dwelling on an object selects it",
)
READ_HISTORY = Request(
    key="selector/history", query=requests.ReadHistory, reply=requests.ReadHistoryReply, server="selector",
    about="the last selection events, from the journal",
)
SET_TOLERANCE = Request(
    key="pui/tolerance", query=requests.SetTolerance, reply=requests.SetToleranceReply, server="pui",
    about="how far a ray may pass its target",
)
USE_MAP = Request(
    key="pui/map", query=requests.UseMap, reply=requests.UseMapReply, server="pui",
    about="use another map, or its changed file: operators only",
)
STOP_ROBOT = Request(
    key="robots/{robot}/stop", query=requests.StopRobot, reply=requests.Done, server="robot",
    about="stop it where it is, and let nobody steer it until somebody takes it again",
)
SAY = Request(
    key="feedback/{user}/say", query=requests.Say, reply=requests.Done, server="supervisor",
    about="tell the person something, by a cue with a text",
)
FIND_REFERENTS = Request(
    key="listener/{user}/referents", query=requests.FindReferents, reply=requests.Referents,
    server="listener", about="what the person meant by a word: only theirs and operators' to ask",
)
SEND_ROBOT = Request(
    key="goal/{user}/send", query=requests.SendRobot, reply=requests.Done, server="goal",
    about="send a robot to a place, with the checks of pointing",
)
RUN_SCENARIO = Request(
    key="run/scenario", query=requests.RunScenario, reply=requests.Done, server="cli",
    about="run another scenario in its place",
)
SET_BRIGHTNESS = Request(
    key="leds/brightness", query=requests.SetBrightness, reply=requests.Done, server="led-driver",
    about="dim all strips",
)
SHOW_PIXELS = Request(
    key="leds/show", query=requests.ShowPixels, reply=requests.Done, server="led-driver",
    about="show given pixels on the strips for a while, to test or to map them",
)
SET_LAMP = Request(
    key="leds/{led}/set_color", query=requests.SetLamp, reply=requests.Done, server="led-driver",
    about="show a colour on a lamp that nobody needs to localize",
)
SET_YAW_ORIGIN = Request(
    key="imu/{user}/set_yaw_origin", query=requests.SetYawOrigin, reply=requests.Done, server="imu-bridge",
    about="set the IMU's yaw",
)
SET_MOUNTING = Request(
    key="imu/{user}/set_mounting", query=requests.SetMounting, reply=requests.SetMountingReply,
    server="imu-bridge", about="how the sensor sits on the arm",
)
SET_UP_HOME = Request(
    key="home/set_up", query=home.SetUpHome, reply=home.HomeSetup, server="home-assistant",
    about="the cards that set up a home: operators only",
)

REQUESTS: list[Request[Any, Any]] = [
    ADD_PACKAGE, SET_SPEED, SET_FEEDING, RESET_CONVEYOR, START_LOCALIZATION, CANCEL_LOCALIZATION, SET_POSE,
    SET_HEADING, POINT_ANCHOR, SET_OFFSET, CLEAR_SELECTION, UNDO_SELECTION,
    RELEASE_OBJECT, SET_THING, BEGIN_ACT, SET_WORKSPACE, SET_METHOD, READ_HISTORY, SET_TOLERANCE, USE_MAP,
    STOP_ROBOT, FIND_REFERENTS, SEND_ROBOT, RUN_SCENARIO, SET_BRIGHTNESS, SHOW_PIXELS, SET_LAMP,
    SET_YAW_ORIGIN, SET_MOUNTING, SAY, SET_UP_HOME,
]
# fmt: on
"""All requests. Services of other packages add theirs when they are loaded."""


# tables: each row takes as few lines as it needs
# fmt: off
__all__ = [
    "ACCOUNTS", "ACT_RESULTS", "ADD_PACKAGE", "ANCHOR", "ANNOUNCED", "ANY", "BEGIN_ACT", "BUTTON",
    "CANCEL_LOCALIZATION",
    "CARRIER_ALIVE", "CLAIM", "CLEAR_SELECTION", "CLOCK", "CONFIGURATION", "CONVEYOR_STATE", "CURSOR",
    "DEPLOYMENT", "FEEDBACK", "FIND_REFERENTS", "GOAL", "HEALTH", "HOVER", "IMU", "INTERACTION",
    "KEEPER_ALIVE", "LAMP_COLOR", "LAMP_LEASES", "LOCALIZATION", "MANNER", "MAP", "MAX_AGE_PERIODS",
    "OBJECTS",
    "OUTCOMES", "POINT_ANCHOR", "POSE", "PRESENCES", "PROFILE", "RAY", "READ_HISTORY", "RELEASE_OBJECT",
    "REQUESTS", "RESET_CONVEYOR", "ROBOT_PLAN", "ROBOT_STATE", "RUN_SCENARIO", "SAY", "SELECTION",
    "SELECTION_EVENTS", "SEND_ROBOT", "SERVED", "SERVICE_ALIVE", "SET_BRIGHTNESS", "SET_FEEDING",
    "SET_HEADING", "SET_LAMP", "SET_METHOD", "SET_MOUNTING", "SET_OFFSET", "SET_POSE", "SET_SPEED",
    "SET_THING", "SET_TOLERANCE", "SET_UP_HOME", "SET_WORKSPACE", "SET_YAW_ORIGIN", "SHARD_ALIVE",
    "SHOW_PIXELS", "SPEECH",
    "START_LOCALIZATION", "STEERING", "STEP", "STOP_ROBOT", "STRIPS_FRAME", "THING_STATES", "TOPICS",
    "UNDERSTOOD", "UNDO_SELECTION", "USER_ALIVE", "USE_MAP", "WRIST", "Delivery", "Presence", "Request",
    "Topic", "check_name", "topic_of",
]

_LATEST = Delivery.LATEST
_EVENT = Delivery.EVENT
_STATE = Delivery.STATE

IMU = Topic(
    key="users/{user}/imu", message=person.ImuSample, delivery=_LATEST, rate_hz=50,
    writers=("imu-bridge", "user-sim"), about="orientation of the arm",
)
WRIST = Topic(
    key="users/{user}/wrist", message=person.WristSample, delivery=_LATEST, rate_hz=None,
    writers=("web", "ros2"),
    about="the hand of a person who points with a mouse, phone or headset, or with a sensor in ROS",
)
BUTTON = Topic(
    key="users/{user}/button", message=person.ButtonEvent, delivery=_EVENT, rate_hz=None,
    writers=("imu-bridge", "user-sim", "web", "ros2", "cli"), about="the person's button",
)
STEP = Topic(
    key="users/{user}/step", message=person.Step, delivery=_EVENT, rate_hz=None,
    writers=("imu-bridge", "web", "cli"), about="to an object beside, above or below the announced one",
)
PROFILE = Topic(
    key="users/{user}/profile", message=person.UserProfile, delivery=_STATE, rate_hz=None,
    writers=("supervisor", "cli", "ros2"), about="body measures, handedness, colour",
)
RAY = Topic(
    key="users/{user}/ray", message=pointing.PointingRay, delivery=_LATEST, rate_hz=50,
    writers=("pointing", "ros2"), about="pointing ray in {H}",
)
POSE = Topic(
    key="users/{user}/pose", message=pointing.UserPose, delivery=_STATE, rate_hz=None,
    writers=("localizer", "mocap", "ros2", "web", "external"), about="{H} in {W}",
)
LOCALIZATION = Topic(
    key="users/{user}/localization", message=pointing.Localization, delivery=_STATE, rate_hz=None,
    writers=("localizer",), about="progress of localizing",
)
ANCHOR = Topic(
    key="users/{user}/anchor", message=pointing.Anchor, delivery=_EVENT, rate_hz=None, writers=("localizer",),
    about="one pointing at a known point, without a cursor",
)
CURSOR = Topic(
    key="users/{user}/cursor", message=pointing.Cursor, delivery=_LATEST, rate_hz=50, writers=("pui",),
    about="where the ray meets the room",
)
HOVER = Topic(
    key="users/{user}/hover", message=pointing.Hover, delivery=_LATEST, rate_hz=50, writers=("selector",),
    about="object under the cursor; while there is none, 5 a second",
)
ANNOUNCED = Topic(
    key="users/{user}/announced", message=pointing.Announced, delivery=_STATE, rate_hz=None,
    writers=("selector",), about="object whose name is spoken to the person; at most 5 a second",
)
CLAIM = Topic(
    key="users/{user}/claim", message=selection.Claim, delivery=_EVENT, rate_hz=None,
    writers=("selector", "cli"), about="object that a person wants: from a shard or words to the selector",
)
INTERACTION = Topic(
    key="users/{user}/interaction", message=pointing.Interaction, delivery=_STATE, rate_hz=None,
    writers=("supervisor", "ros2"), about="life cycle of the interaction",
)
FEEDBACK = Topic(
    key="users/{user}/feedback", message=pointing.Feedback, delivery=_EVENT, rate_hz=None,
    writers=("supervisor", "selector", "goal", "pui"), about="cues: haptic, chime, light",
)
GOAL = Topic(
    key="users/{user}/goal", message=pointing.Goal, delivery=_EVENT, rate_hz=None, writers=("goal",),
    about="where the person sends a robot",
)
SPEECH = Topic(
    key="users/{user}/speech", message=person.Speech, delivery=_EVENT, rate_hz=None,
    writers=("web", "cli", "external"), about="words of the person, with their times",
)
UNDERSTOOD = Topic(
    key="users/{user}/understood", message=person.Understood, delivery=_EVENT, rate_hz=None,
    writers=("cli", "external"), about="what was understood of the person's words, and what came of it",
)
MAP = Topic(
    key="map", message=environment.Environment, delivery=_STATE, rate_hz=None, writers=("pui",),
    about="the room",
)
OBJECTS = Topic(
    key="objects/{tracker}", message=environment.TrackedObjects, delivery=_LATEST, rate_hz=25,
    writers=("conveyor-sim", "robot-replay", "robot", "mocap", "agv-tracker", "ros2", "external", "pui"),
    about="moving objects, things of the map, and true poses of people; each tracker lists its own",
)
SELECTION = Topic(
    key="selection", message=selection.Selection, delivery=_STATE, rate_hz=None, writers=("selector",),
    about="selected objects",
)
MANNER = Topic(
    key="selection/manner", message=selection.SelectionManner, delivery=_STATE, rate_hz=None,
    writers=("selector",), about="how people select: by staying, a press, or names",
)
SELECTION_EVENTS = Topic(
    key="selection/events", message=selection.SelectionEvent, delivery=_EVENT, rate_hz=None,
    writers=("selector", "conveyor-sim"), about="selected, deselected, left",
)
THING_STATES = Topic(
    key="things/{carrier}", message=selection.ThingStates, delivery=_STATE, rate_hz=None,
    writers=("reactions", "home-assistant", "conveyor-sim", "cli", "external"),
    about="things that a carrier acts on, and their states",
)
ACT_RESULTS = Topic(
    key="acts/{carrier}", message=selection.ActResult, delivery=_EVENT, rate_hz=None,
    writers=("reactions", "home-assistant", "conveyor-sim", "cli", "external"),
    about="result of each act that a carrier carried out",
)
OUTCOMES = Topic(
    key="selection/outcomes", message=selection.ActOutcome, delivery=_EVENT, rate_hz=None,
    writers=("selector",), about="result of each selection event that has carriers, by all of them",
)
LAMP_COLOR = Topic(
    key="leds/{led}/color", message=environment.LampColor, delivery=_STATE, rate_hz=None,
    writers=("led-driver",), about="colour of a single lamp",
)
LAMP_LEASES = Topic(
    key="leds/leases", message=environment.LampLeases, delivery=_STATE, rate_hz=None, writers=("led-driver",),
    about="people who have lamps to themselves, or wait for them",
)
STRIPS_FRAME = Topic(
    key="strips/frame", message=environment.StripsFrame, delivery=_LATEST, rate_hz=None,
    writers=("led-driver",), about="pixels of every strip, at most 60 Hz",
)
CONVEYOR_STATE = Topic(
    key="conveyor/state", message=environment.ConveyorState, delivery=_STATE, rate_hz=None,
    writers=("conveyor-sim",), about="speed and counts",
)
CLOCK = Topic(
    key="clock", message=system.ClockTick, delivery=_STATE, rate_hz=None, writers=("cli", "ros2"),
    about="simulated time",
)
HEALTH = Topic(
    key="health/{service}", message=system.Health, delivery=_LATEST, rate_hz=1, writers=("every service",),
    about="each service's own account; {service} is its instance",
)
CONFIGURATION = Topic(
    key="configuration/{service}", message=system.Configuration, delivery=_STATE, rate_hz=None,
    writers=("every service",), about="parameters of each service since its start; {service} is its instance",
)
SERVED = Topic(
    key="requests/{service}", message=system.ServedRequest, delivery=_EVENT, rate_hz=None,
    writers=("every service",),
    about="requests that each service has answered, with the replies; {service} is its instance",
)
DEPLOYMENT = Topic(
    key="deployment/{name}", message=system.Deployment, delivery=_STATE, rate_hz=None, writers=("cli",),
    about="services that should be running",
)

TOPICS: list[Topic[Any]] = [
    IMU, WRIST, BUTTON, STEP, PROFILE, RAY, POSE, LOCALIZATION, ANCHOR, CURSOR, HOVER, ANNOUNCED, CLAIM,
    INTERACTION, FEEDBACK, GOAL, STEERING, SPEECH, UNDERSTOOD, MAP, OBJECTS, ROBOT_STATE, ROBOT_PLAN,
    SELECTION, MANNER, SELECTION_EVENTS, THING_STATES, ACT_RESULTS, OUTCOMES, LAMP_COLOR, LAMP_LEASES,
    STRIPS_FRAME, CONVEYOR_STATE, CLOCK, HEALTH, CONFIGURATION, SERVED, DEPLOYMENT,
]
"""All topics. Services of other packages add theirs when they are loaded (`pointit.services.registry`)."""

ACCOUNTS: tuple[Topic[Any], ...] = (HEALTH, CONFIGURATION, SERVED)
"""Topics on which the runtime reports for each service, under its instance."""

SERVICE_ALIVE = Presence(key="alive/services/{instance}", about="one service instance runs")
USER_ALIVE = Presence(key="alive/users/{user}", about="one person's services run")

SHARD_ALIVE = Presence(
    key="alive/shards/{instance}",
    about="a shard of a service serves one person: `pui.anna`, whatever the shard's own name",
)
CARRIER_ALIVE = Presence(key="alive/carriers/{carrier}", about="a carrier of acts runs")
# fmt: on
KEEPER_ALIVE = Presence(key="alive/keepers/{session}", about="it answers for states whose writers are gone")

PRESENCES: tuple[Presence, ...] = (SERVICE_ALIVE, USER_ALIVE, SHARD_ALIVE, CARRIER_ALIVE, KEEPER_ALIVE)


def topic_of(key: str) -> Topic[Any] | None:
    """Return the row whose key pattern fits `key` (relative to the site), or None."""
    for topic in TOPICS:
        if not topic.placeholder:
            if topic.key == key:
                return topic
            continue
        name = topic.name_in(key)
        if name == ANY or NAME.match(name):
            return topic
    return None
