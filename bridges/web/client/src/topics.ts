// Rows of the bus's tables, from schemas/catalogue/shipped. Written by `npm run types`; do not edit.

import type {
  Anchor, Announced, ButtonEvent, Claim, ClockTick, Configuration, ConveyorState, Cursor, Deployment, Environment, Feedback, Goal, Health, Hover, ImuSample, Interaction, LampColor, LampLeases, Localization, PointingRay, RobotPlan, RobotState, Selection, SelectionEvent, ServedRequest, Speech, Steering, Step, StripsFrame, TrackedObjects, Understood, UserPose, UserProfile, WristSample,
} from "./messages";

/** The message of every topic, by the key's pattern. */
export interface Topics {
  "clock": ClockTick;
  "configuration/{service}": Configuration;
  "conveyor/state": ConveyorState;
  "deployment/{name}": Deployment;
  "health/{service}": Health;
  "leds/leases": LampLeases;
  "leds/{led}/color": LampColor;
  "map": Environment;
  "objects/{tracker}": TrackedObjects;
  "requests/{service}": ServedRequest;
  "robots/{robot}/plan": RobotPlan;
  "robots/{robot}/state": RobotState;
  "selection": Selection;
  "selection/events": SelectionEvent;
  "strips/frame": StripsFrame;
  "users/{user}/anchor": Anchor;
  "users/{user}/announced": Announced;
  "users/{user}/button": ButtonEvent;
  "users/{user}/claim": Claim;
  "users/{user}/cursor": Cursor;
  "users/{user}/feedback": Feedback;
  "users/{user}/goal": Goal;
  "users/{user}/hover": Hover;
  "users/{user}/imu": ImuSample;
  "users/{user}/interaction": Interaction;
  "users/{user}/localization": Localization;
  "users/{user}/pose": UserPose;
  "users/{user}/profile": UserProfile;
  "users/{user}/ray": PointingRay;
  "users/{user}/speech": Speech;
  "users/{user}/steering": Steering;
  "users/{user}/step": Step;
  "users/{user}/understood": Understood;
  "users/{user}/wrist": WristSample;
}

/** The service that answers each request, by the key's pattern. */
export const SERVERS = {
  "conveyor/add_package": "conveyor-sim",
  "conveyor/reset": "conveyor-sim",
  "conveyor/set_feeding": "conveyor-sim",
  "conveyor/set_speed": "conveyor-sim",
  "feedback/{user}/say": "supervisor",
  "goal/{user}/send": "goal",
  "imu/{user}/set_mounting": "imu-bridge",
  "imu/{user}/set_yaw_origin": "imu-bridge",
  "leds/brightness": "led-driver",
  "leds/show": "led-driver",
  "leds/{led}/set_color": "led-driver",
  "listener/{user}/referents": "listener",
  "localizer/{user}/cancel": "localizer",
  "localizer/{user}/point_anchor": "localizer",
  "localizer/{user}/set_heading": "localizer",
  "localizer/{user}/set_pose": "localizer",
  "localizer/{user}/start": "localizer",
  "profile/{user}/set_offset": "supervisor",
  "pui/map": "pui",
  "pui/tolerance": "pui",
  "pui/{user}/set_workspace": "pui",
  "robots/{robot}/stop": "robot",
  "run/scenario": "cli",
  "selector/history": "selector",
  "selector/method": "selector",
  "selector/{user}/clear": "selector",
  "selector/{user}/release": "selector",
  "selector/{user}/set_thing": "selector",
  "selector/{user}/undo": "selector",
} as const;

export type RequestKey = keyof typeof SERVERS;
