"""The table of requests: every question a service answers; `topics` has its names too."""

from typing import Any

from pointit.schemas import requests
from pointit.schemas.table_types import Request

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

REQUESTS: list[Request[Any, Any]] = [
    ADD_PACKAGE, SET_SPEED, SET_FEEDING, RESET_CONVEYOR, START_LOCALIZATION, CANCEL_LOCALIZATION, SET_POSE,
    SET_HEADING, POINT_ANCHOR, SET_OFFSET, CLEAR_SELECTION, UNDO_SELECTION,
    RELEASE_OBJECT, SET_THING, SET_WORKSPACE, SET_METHOD, READ_HISTORY, SET_TOLERANCE, USE_MAP, STOP_ROBOT,
    FIND_REFERENTS, SEND_ROBOT, RUN_SCENARIO, SET_BRIGHTNESS, SHOW_PIXELS, SET_LAMP, SET_YAW_ORIGIN,
    SET_MOUNTING, SAY,
]
# fmt: on
"""All requests. Services of other packages add theirs when they are loaded."""
