// The bus's messages, from schemas/catalogue/shipped. Written by `npm run types`; do not edit.

export interface Everything {
  AddPackage: AddPackage;
  AddPackageReply: AddPackageReply;
  Anchor: Anchor;
  Announced: Announced;
  ButtonEvent: ButtonEvent;
  CancelLocalization: CancelLocalization;
  Claim: Claim;
  ClearSelection: ClearSelection;
  ClockTick: ClockTick;
  Configuration: Configuration;
  BayCount: BayCount;
  BeltSpeed: BeltSpeed;
  Departure: Departure;
  ConveyorState: ConveyorState;
  LampMiss: LampMiss;
  Passed: Passed;
  Cursor: Cursor;
  ExpectedService: ExpectedService;
  Deployment: Deployment;
  Done: Done;
  Bay: Bay;
  Belt: Belt;
  BeltLink: BeltLink;
  Box: Box;
  Cloud: Cloud;
  Cylinder: Cylinder;
  Fence: Fence;
  Frame: Frame;
  Lamp: Lamp;
  Plane: Plane;
  Sphere: Sphere;
  Strip: Strip;
  Thing: Thing;
  Environment: Environment;
  Feedback: Feedback;
  FindReferents: FindReferents;
  Goal: Goal;
  Figure: Figure;
  KeyHealth: KeyHealth;
  Quantiles: Quantiles;
  Health: Health;
  Hover: Hover;
  ImuSample: ImuSample;
  Interaction: Interaction;
  LampColor: LampColor;
  LampLease: LampLease;
  LampLeases: LampLeases;
  Candidate: Candidate;
  Localization: Localization;
  PointAnchor: PointAnchor;
  PointingRay: PointingRay;
  ReadHistory: ReadHistory;
  SelectionEvent: SelectionEvent;
  ReadHistoryReply: ReadHistoryReply;
  Referent: Referent;
  Referents: Referents;
  ReleaseObject: ReleaseObject;
  ResetConveyor: ResetConveyor;
  RobotPlan: RobotPlan;
  RobotState: RobotState;
  RunScenario: RunScenario;
  Say: Say;
  ReservedObject: ReservedObject;
  SelectedObject: SelectedObject;
  Selection: Selection;
  SendRobot: SendRobot;
  ServedRequest: ServedRequest;
  SetBrightness: SetBrightness;
  SetFeeding: SetFeeding;
  SetHeading: SetHeading;
  SetLamp: SetLamp;
  SetMethod: SetMethod;
  SetMethodReply: SetMethodReply;
  SetMounting: SetMounting;
  SetMountingReply: SetMountingReply;
  PointingOffset: PointingOffset;
  SetOffset: SetOffset;
  RememberedBias: RememberedBias;
  SetPose: SetPose;
  SetSpeed: SetSpeed;
  SetThing: SetThing;
  SetTolerance: SetTolerance;
  SetToleranceReply: SetToleranceReply;
  SetWorkspace: SetWorkspace;
  SetYawOrigin: SetYawOrigin;
  LitPixels: LitPixels;
  ShowPixels: ShowPixels;
  Word: Word;
  Speech: Speech;
  StartLocalization: StartLocalization;
  Steering: Steering;
  Step: Step;
  StopRobot: StopRobot;
  StripFrame: StripFrame;
  StripsFrame: StripsFrame;
  TrackedObject: TrackedObject;
  TrackedObjects: TrackedObjects;
  Understood: Understood;
  UndoSelection: UndoSelection;
  UseMap: UseMap;
  UseMapReply: UseMapReply;
  UserPose: UserPose;
  BodyMeasures: BodyMeasures;
  UserProfile: UserProfile;
  WristSample: WristSample;
}
/**
 * Put one object on a lane of the conveyor.
 */
export interface AddPackage {
  kind: string;
  /**
   * strip or belt id; empty for the first lane
   */
  lane: string;
  length_m: number;
  /**
   * share of the lane's length from its start; None for the feed point
   */
  position: number | null;
}
/**
 * The object's id.
 */
export interface AddPackageReply {
  /**
   * the effect, in one sentence for a person
   */
  message: string;
  object_id: string;
}
/**
 * One pointing at a known point without a cursor, which shows a person's offset and an IMU's drift.
 *
 * `stamp_ns`: the middle of the hold.
 */
export interface Anchor {
  /**
   * whether the pose was set right by it
   */
  accepted: boolean;
  /**
   * target less ray, in the pose before this anchor; positive: to the left
   */
  azimuth_error_rad: number;
  /**
   * the same without the person's offset
   *
   * @minItems 3
   * @maxItems 3
   */
  direction: [number, number, number];
  /**
   * the same; positive: the target is higher
   */
  elevation_error_rad: number;
  /**
   * of the ray, {H}
   *
   * @minItems 3
   * @maxItems 3
   */
  origin_m: [number, number, number];
  /**
   * of {H} in {W} before this anchor
   *
   * @minItems 3
   * @maxItems 3
   */
  position_m: [number, number, number];
  /**
   * mean of the raw rays, {H}
   *
   * @minItems 3
   * @maxItems 3
   */
  raw_direction: [number, number, number];
  /**
   * reason of a rejection and the remedy
   */
  reason: string;
  samples: number;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * rms of the rays about their mean
   */
  spread_rad: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  /**
   * lamp or object; empty for a mere direction
   */
  target_id: string;
  /**
   * {W}
   */
  target_m: [number, number, number] | null;
  /**
   * of {H} in {W} before this anchor
   */
  yaw_rad: number;
}
/**
 * The object whose name is spoken to the person, since they point at it or stepped to it.
 *
 * The first message has no object: it says that names are spoken to the person.
 */
export interface Announced {
  /**
   * when the name began; a later one for the same object: it is spoken again
   */
  began_ns: number;
  /**
   * text to speak; empty when none
   */
  label: string;
  /**
   * empty when none
   */
  object_id: string;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
}
/**
 * The person pressed their button; presses move the interaction on.
 */
export interface ButtonEvent {
  gesture: "press" | "double" | "hold";
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * device, page, headset, keyboard, joypad, simulated
   */
  source: string;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
}
/**
 * Stop localizing and keep the last pose.
 */
export interface CancelLocalization {
  /**
   * forget the elevation bias that earlier localizations told, as of another person
   */
  forget_bias: boolean;
}
/**
 * A person served by a shard of the selector wants an object. The site's selector decides.
 *
 * The event of its decision has the stamp of a claim to toggle.
 */
export interface Claim {
  /**
   * effect of `toggle` that is meant; refused if it has another one by then
   */
  action: ("select" | "deselect") | null;
  /**
   * action of the person
   */
  cause: "dwell" | "button";
  /**
   * that this object was meant
   */
  confidence: number | null;
  object_id: string;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  /**
   * keep it for them for a moment, or (de)select it
   */
  wish: "reserve" | "toggle";
}
/**
 * Deselect everything a person has selected.
 */
export interface ClearSelection {}
/**
 * Simulated time: at wall time `stamp_ns` it was `sim_ns`, and it runs `speed` times as fast.
 */
export interface ClockTick {
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * till 2116: times reckoned from it fit too
   */
  sim_ns: number;
  speed: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
}
/**
 * The parameters with which a service has started.
 */
export interface Configuration {
  instance: string;
  /**
   * JSON of all parameters but secrets
   */
  parameters: string;
  /**
   * version of PointIt
   */
  release: string;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  service: string;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  user: string;
}
/**
 * Counts of the objects that came out at a bay.
 */
export interface BayCount {
  /**
   * empty: at the end of a belt without a bay
   */
  bay: string;
  count: number;
  kind: string;
  /**
   * number of selected ones among them
   */
  selected: number;
}
/**
 * The speed of one belt.
 */
export interface BeltSpeed {
  id: string;
  speed_mps: number;
}
/**
 * An object that came out at a bay.
 */
export interface Departure {
  /**
   * empty for a belt's end
   */
  bay: string;
  object_id: string;
  stamp_ns: number;
  /**
   * person for whom it was sent there, or empty
   */
  user: string;
}
/**
 * The state of the conveyor.
 */
export interface ConveyorState {
  bays: BayCount[];
  /**
   * those with a speed of their own
   */
  belts: BeltSpeed[];
  /**
   * the latest objects that left and were selected, oldest first
   */
  departures: Departure[];
  /**
   * objects put on the conveyor so far
   */
  fed: number;
  /**
   * false while the feeders are stopped
   */
  feeding: boolean;
  /**
   * objects that reached the end of their lane
   */
  left: number;
  /**
   * selections that came past the point of no return
   */
  refused: number;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * 0: it stands still; negative: backwards
   */
  speed_mps: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  /**
   * of a feeding schedule, or empty; `end`: nothing more is fed
   */
  step: string;
}
/**
 * Distance at which the ray passes a lamp.
 */
export interface LampMiss {
  id: string;
  miss_rad: number;
}
/**
 * The thing nearest to a ray that passes everything by, and how the ray has to turn to meet it.
 */
export interface Passed {
  /**
   * nearest point of it, {W}
   *
   * @minItems 3
   * @maxItems 3
   */
  point_m: [number, number, number];
  /**
   * arc length of that point along a strip or belt
   */
  position_m: number;
  /**
   * azimuth to turn to the right; negative: to the left
   */
  right_rad: number;
  solid: "" | "box" | "plane" | "cylinder" | "sphere";
  surface: "none" | "strip" | "belt" | "lamp" | "points";
  surface_id: string;
  /**
   * the same for the person, once they pointed past for a while; else empty
   */
  text: string;
  /**
   * elevation to turn up; negative: down
   */
  up_rad: number;
}
/**
 * The intersection of the pointing ray with the environment, in {W}.
 */
export interface Cursor {
  /**
   * of the ray, {W}
   */
  direction: [number, number, number] | null;
  /**
   * lamps near the ray, where that is asked for
   */
  lamps: LampMiss[];
  /**
   * from the ray to the point
   */
  miss_m: number;
  /**
   * angle at the eyes between ray and point
   */
  miss_rad: number;
  /**
   * where the ray begins, {W}
   */
  origin_m: [number, number, number] | null;
  /**
   * nearest thing, where the ray passes everything and the arm does not rest
   */
  passed: Passed | null;
  /**
   * on the surface, {W}
   */
  point_m: [number, number, number] | null;
  /**
   * arc length along a strip or belt from its start
   */
  position_m: number;
  /**
   * from the eyes to the point
   */
  range_m: number;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * thing with an area it is on; `surface` is none then
   */
  solid: "" | "box" | "plane" | "cylinder" | "sphere";
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  surface: "none" | "strip" | "belt" | "lamp" | "points";
  surface_id: string;
  /**
   * place on such a thing, in its own two axes
   */
  uv_m: [number, number] | null;
}
/**
 * A service that should be running, and the command that starts it again.
 */
export interface ExpectedService {
  command: string[];
  /**
   * among several of its kind on the site, or empty
   */
  name: string;
  service: string;
  user: string;
}
/**
 * Services started by `pointit run` or `pointit person add`, by which `doctor` finds missing ones.
 */
export interface Deployment {
  /**
   * people are found by pointing at lamps
   */
  localizes: boolean;
  /**
   * the scenario, or the user
   */
  name: string;
  /**
   * name of the running one, or empty if it has none
   */
  scenario: string;
  /**
   * alternatives on request; empty if it accepts none
   */
  scenarios: string[];
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  services: ExpectedService[];
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  /**
   * kinds of objects to select; empty if all are right
   */
  target_kinds: string[];
}
/**
 * It was done.
 */
export interface Done {
  /**
   * the effect, in one sentence for a person
   */
  message: string;
}
/**
 * The end of a belt, where objects leave the conveyor.
 */
export interface Bay {
  belt: string;
  id: string;
}
/**
 * A conveyor belt along its centre line.
 */
export interface Belt {
  id: string;
  line_m: [number, number, number][];
  width_m: number;
}
/**
 * One belt hands its objects over to another; where several leave at one place, a diverter chooses.
 */
export interface BeltLink {
  source: string;
  /**
   * arc length on `source` where they leave it; None for its end
   */
  source_position_m: number | null;
  target: string;
  /**
   * arc length on `target` where they enter it
   */
  target_position_m: number;
}
/**
 * A box that stands upright.
 */
export interface Box {
  /**
   * @minItems 3
   * @maxItems 3
   */
  center_m: [number, number, number];
  id: string;
  /**
   * along its own x, y and z
   *
   * @minItems 3
   * @maxItems 3
   */
  size_m: [number, number, number];
  /**
   * of its x axis in {W}
   */
  yaw_rad: number;
}
/**
 * A point cloud, read from a file by the process that casts rays. The points are not in the message.
 */
export interface Cloud {
  /**
   * greatest x, y, z
   *
   * @minItems 3
   * @maxItems 3
   */
  high_m: [number, number, number];
  id: string;
  /**
   * least x, y, z
   *
   * @minItems 3
   * @maxItems 3
   */
  low_m: [number, number, number];
  points: number;
}
/**
 * An upright cylinder: a column, a tank.
 */
export interface Cylinder {
  /**
   * of its foot
   *
   * @minItems 3
   * @maxItems 3
   */
  center_m: [number, number, number];
  height_m: number;
  id: string;
  radius_m: number;
}
/**
 * An upright volume for robots: each stays inside every `keep_in`, and outside every `keep_out`.
 */
export interface Fence {
  /**
   * greatest height in {W}, None if unbounded
   */
  high_m: number | null;
  id: string;
  kind: "keep_in" | "keep_out";
  /**
   * least height in {W}, None if unbounded
   */
  low_m: number | null;
  /**
   * x, y of its corners in {W}, in either order; it closes itself
   */
  outline_m: [number, number][];
}
/**
 * The coordinates of a tracker, or of a robot: where their origin is in {W}, and their rotation.
 */
export interface Frame {
  id: string;
  /**
   * rotates vectors of the frame into {W}
   *
   * @minItems 4
   * @maxItems 4
   */
  orientation_xyzw: [number, number, number, number];
  /**
   * of its origin in {W}
   *
   * @minItems 3
   * @maxItems 3
   */
  position_m: [number, number, number];
}
/**
 * A single light at a known place; target of localizations.
 */
export interface Lamp {
  id: string;
  /**
   * @minItems 3
   * @maxItems 3
   */
  position_m: [number, number, number];
}
/**
 * A flat thing that is seen from both sides: a floor, a wall, a table, a screen.
 *
 * Its v axis is the one in the plane that rises most (y where the plane is level), u is v x normal.
 */
export interface Plane {
  /**
   * @minItems 3
   * @maxItems 3
   */
  center_m: [number, number, number];
  id: string;
  /**
   * @minItems 3
   * @maxItems 3
   */
  normal: [number, number, number];
  /**
   * along u and v; None if unbounded
   */
  size_m: [number, number] | null;
}
/**
 * A ball.
 */
export interface Sphere {
  /**
   * @minItems 3
   * @maxItems 3
   */
  center_m: [number, number, number];
  id: string;
  radius_m: number;
}
/**
 * An LED strip along a polyline.
 */
export interface Strip {
  /**
   * -1: pixel 0 sits at the line's last vertex
   */
  direction: 1 | -1;
  id: string;
  line_m: [number, number, number][];
  pixels: number;
}
/**
 * A place in the room that reacts when somebody points at it: a box, with a light if it has one.
 *
 * `pui` lists all things of the map as tracked objects of the tracker `things`, by which they are selected.
 */
export interface Thing {
  /**
   * @minItems 3
   * @maxItems 3
   */
  center_m: [number, number, number];
  /**
   * time on it that selects it, s; the method's if empty
   */
  dwell_s: number | null;
  /**
   * entity there, or JSON: entity, action, data
   */
  home_assistant: string;
  id: string;
  /**
   * the tracked object of this id, wherever that is
   */
  is_tracked: boolean;
  /**
   * its name in messages to people; if empty, the id
   */
  label: string;
  /**
   * single light that shows its state, or empty
   */
  lamp: string;
  mode: "claim" | "button" | "switch";
  /**
   * arc lengths of that part, from and to
   *
   * @minItems 2
   * @maxItems 2
   */
  part_m: [number, number];
  /**
   * pointing at it is not enough: the person presses, too
   */
  press: boolean;
  /**
   * along its own x, y and z
   *
   * @minItems 3
   * @maxItems 3
   */
  size_m: [number, number, number];
  /**
   * strip a part of which shows its state, or empty
   */
  strip: string;
  /**
   * of its x axis in {W}
   */
  yaw_rad: number;
}
/**
 * The map of the room in {W}; the ROS toolkit's `belts`, `leds`, `strips`, `links`, and more.
 */
export interface Environment {
  bays: Bay[];
  belts: Belt[];
  boxes: Box[];
  clouds: Cloud[];
  cylinders: Cylinder[];
  fences: Fence[];
  frames: Frame[];
  lamps: Lamp[];
  links: BeltLink[];
  name: string;
  planes: Plane[];
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  spheres: Sphere[];
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  strips: Strip[];
  things: Thing[];
}
/**
 * A cue for the person's senses.
 */
export interface Feedback {
  /**
   * sound to play
   */
  chime: "" | "up" | "down" | "single" | "double" | "buzz" | "tick" | "tock";
  /**
   * short flash of a state lamp
   */
  color: [number, number, number] | null;
  cue: "started" | "stopped" | "target" | "localized" | "refused" | "selected" | "deselected";
  /**
   * vibration pattern: on, off, on ..., ms; empty for none
   */
  haptic_ms: number[];
  /**
   * position that it refers to, {W}, or None
   */
  point_m: [number, number, number] | null;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  /**
   * target that the person should point at
   */
  target_id: string;
  text: string;
  /**
   * rotation to the target, right and up, if the ray misses everything; else None
   */
  turn_rad: [number, number] | null;
  /**
   * there is nothing to do yet but wait for the next cue
   */
  waits: boolean;
}
/**
 * Find what a person meant by a word, from where they pointed before, at and after it.
 *
 * Answered at once, from the rays that are there: ask a moment after the word.
 */
export interface FindReferents {
  /**
   * middle of the word; None for now
   */
  at_ns: number | null;
  /**
   * middles of the other deictic words of the sentence
   */
  others_ns: number[];
  /**
   * rays count up to so long before and after the word, s
   */
  within_s: number;
  /**
   * the word; empty for any
   */
  word: "" | "this" | "that" | "here" | "there" | "these";
}
/**
 * A place at which a person pointed in two steps, where a robot is to go, {W}; no safety function.
 *
 * `stamp_ns`: of the ray with which it was confirmed. Who receives it judges it: late, or unsure, it is not
 * to be followed.
 */
export interface Goal {
  /**
   * of that ray when the goal was given
   */
  age_s: number;
  /**
   * on the floor from there to the nearest person with a known position
   */
  clearance_m: number;
  /**
   * by pointing there once more, or by their button
   */
  confirmed_by: "again" | "press";
  /**
   * @minItems 3
   * @maxItems 3
   */
  position_m: [number, number, number];
  /**
   * 1 sigma along the worse direction, of the person's place and aim
   */
  position_sigma_m: number;
  /**
   * stamp of the ray with which it was proposed
   */
  proposed_ns: number;
  /**
   * that is to go there, or empty if any may
   */
  robot: string;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  /**
   * level plane of the map it is on, or `workspace/horizontal`; empty if unknown
   */
  surface_id: string;
  /**
   * way-points before `position_m`, in order, {W}
   */
  via_m: [number, number, number][];
  /**
   * azimuth from the person to the place: facing on, on arrival
   */
  yaw_rad: number;
}
/**
 * A number of a service's own, such as a drift.
 */
export interface Figure {
  name: string;
  unit: string;
  value: number;
}
/**
 * Traffic of one service on one topic over the last second.
 */
export interface KeyHealth {
  /**
   * since the newest, or None without one
   */
  age_s: number | null;
  direction: "in" | "out";
  /**
   * conflated or overflowed, since the start
   */
  dropped: number;
  /**
   * did not decode or validate, since the start
   */
  invalid: number;
  key: string;
  /**
   * events that never arrived, since the start
   */
  lost: number;
  rate_hz: number;
}
/**
 * Median and 99th percentile, seconds, over the last second, and how the values are distributed.
 */
export interface Quantiles {
  /**
   * number of values in each bucket, up to and with 0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5 s and above; empty if they were not counted
   */
  counts: number[];
  p50_s: number;
  p99_s: number;
  /**
   * sum of the counted values
   */
  sum_s: number;
}
/**
 * One service's own account, once a second.
 */
export interface Health {
  /**
   * handlers that raised, since the start
   */
  errors: number;
  /**
   * further metrics of the service
   */
  figures: Figure[];
  host: string;
  instance: string;
  keys: KeyHealth[];
  /**
   * from capture to its output
   */
  latency: Quantiles | null;
  pid: number;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  service: string;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  status: "ok" | "degraded";
  /**
   * time spent in its handlers
   */
  step: Quantiles | null;
  uptime_s: number;
  user: string;
  /**
   * problems and their remedies
   */
  warnings: string[];
}
/**
 * The object under the person's cursor and how far its selection has come.
 */
export interface Hover {
  /**
   * effect of dwelling there
   */
  action: "" | "select" | "deselect" | "refuse";
  is_selected: boolean;
  /**
   * from the ray to the object, 0: on it
   */
  miss_rad: number | null;
  /**
   * empty when none
   */
  object_id: string;
  progress: number;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * position that attracts the cursor, {W}; the true one is the cursor's
   */
  snapped_m: [number, number, number] | null;
  /**
   * the same along the cursor's surface; None if nothing attracts it
   */
  snapped_position_m: number | null;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  /**
   * other person who has selected or reserved it
   */
  taken_by: string;
}
/**
 * Orientation of the arm: rotates vectors of the arm frame (x along the arm to the finger) into {H}.
 *
 * {H} is at the person's feet, z up, x forward at IMU yaw 0. The publisher has already removed the mounting
 * of the sensor on the arm.
 */
export interface ImuSample {
  /**
   * in the arm frame, m/s²
   */
  acceleration_mps2: [number, number, number] | null;
  /**
   * in the arm frame, rad/s
   */
  angular_velocity_radps: [number, number, number] | null;
  /**
   * charge left, 0 to 1
   */
  battery: number | null;
  /**
   * the device's own clock, ns
   */
  device_time_ns: number | null;
  /**
   * 1 sigma of the error of stamp_ns, s; None if unknown
   */
  latency_sigma_s: number | null;
  /**
   * kind of device and how it sits on the arm, such as `ble metamotion`; empty if unknown. With another one a person's pointing has other systematic errors
   */
  mounting: string;
  /**
   * @minItems 4
   * @maxItems 4
   */
  orientation_xyzw: [number, number, number, number];
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  /**
   * number of resets of the yaw origin: a request, another mounting, a restart
   */
  yaw_epoch: number;
}
/**
 * State of the person in the interaction's life cycle (paper, §II-D), and their next step.
 */
export interface Interaction {
  /**
   * people to be localized before, in turn; also empty without a request
   */
  ahead: string[];
  /**
   * the person's direction has become uncertain: a double press, then pointing at a lamp once, sets it right
   */
  is_unsure: boolean;
  /**
   * instruction to the person, in one sentence
   */
  next_step: string;
  /**
   * why the state was entered
   */
  reason: string;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  state: "idle" | "localizing" | "pointing";
}
/**
 * The colour of a single lamp. Black is off.
 */
export interface LampColor {
  /**
   * @minItems 3
   * @maxItems 3
   */
  color: [number, number, number];
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
}
/**
 * One person's place in the queue for lamps.
 */
export interface LampLease {
  /**
   * people who come first; if empty, the lamps are theirs until they end
   */
  ahead: string[];
  lamps: string[];
  /**
   * `since_ns` of their localization, which is their place
   */
  since_ns: number;
  user: string;
}
/**
 * People who use lamps to localize or wait for them, in order. led-driver decides.
 */
export interface LampLeases {
  leases: LampLease[];
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
}
/**
 * A thing that may be meant, and how probably.
 */
export interface Candidate {
  object_id: string;
  probability: number;
}
/**
 * Progress of one localization, for the person and a dashboard; its lamps are lit by led-driver.
 */
export interface Localization {
  /**
   * people at the lamps or ahead in the queue; the person waits, not sampling
   */
  ahead: string[];
  /**
   * of several robots, which may be meant; the likeliest first
   */
  candidates: Candidate[];
  /**
   * lamps that nobody else can use meanwhile; `target_id` among them is to be lit
   */
  lamps: string[];
  phase: "idle" | "sampling" | "solved" | "refused" | "cancelled";
  /**
   * 1 sigma along the worse direction, so far; None if unknown
   */
  position_sigma_m: number | null;
  progress: number;
  /**
   * to find the pose, or to set one right by pointing at one known place
   */
  purpose: "pose" | "anchor";
  /**
   * reason of a refusal and the remedy
   */
  reason: string;
  residual_rad: number | null;
  /**
   * rays gathered so far
   */
  samples: number;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * when this localization began; 0: none has
   */
  since_ns: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  target_count: number;
  /**
   * lamp or robot to point at now, or empty
   */
  target_id: string;
  target_index: number;
  /**
   * 1 sigma so far, or None if unknown
   */
  yaw_sigma_rad: number | null;
}
/**
 * Ask the person to point at one lamp without a cursor, to correct their pose.
 */
export interface PointAnchor {
  /**
   * its id, or empty for the most informative one
   */
  lamp: string;
}
/**
 * The pointing ray in {H}: from the eyes through the fingertip (paper, §II-A).
 */
export interface PointingRay {
  /**
   * the person's offset as it was added to the raw azimuth
   */
  azimuth_correction_rad: number;
  /**
   * filtered, without the person's offset
   *
   * @minItems 3
   * @maxItems 3
   */
  direction: [number, number, number];
  /**
   * the same of the elevation
   */
  elevation_correction_rad: number;
  /**
   * 1 sigma of the person's remaining elevation error; None if not calibrated
   */
  elevation_sigma_rad: number | null;
  /**
   * @minItems 3
   * @maxItems 3
   */
  origin_m: [number, number, number];
  /**
   * of the model alone: neither filtered nor corrected
   */
  raw_direction: [number, number, number] | null;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
}
/**
 * Read the last selection events that the selector published, from its journal.
 */
export interface ReadHistory {
  /**
   * so many at most
   */
  last: number;
  /**
   * nothing before, Unix ns
   */
  since_ns: number;
}
/**
 * Something happened to an object: a person (de)selected it, or it left.
 */
export interface SelectionEvent {
  /**
   * of `dispatched`: where it went
   */
  bay: string;
  /**
   * action of the person; empty if none or unknown
   */
  cause: "" | "dwell" | "button" | "undo" | "clear" | "release";
  /**
   * that this object was meant
   */
  confidence: number | null;
  event: "selected" | "deselected" | "refused" | "left" | "dispatched";
  kind: string;
  object_id: string;
  reason: string;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  /**
   * acting person; of `left` and `dispatched`: for whom it went there, or empty
   */
  user: string;
}
/**
 * The published events, as far as there is room. The oldest are left out.
 */
export interface ReadHistoryReply {
  /**
   * the latest last; number, stamp, object and event are those of the message then
   */
  events: SelectionEvent[];
  /**
   * the effect, in one sentence for a person
   */
  message: string;
}
/**
 * Something that a word may refer to.
 */
export interface Referent {
  kind: "thing" | "robot" | "object" | "person" | "place" | "direction";
  /**
   * of the thing, robot, object or person; of a place its surface
   */
  name: string;
  /**
   * where it is, {W}; None of a direction
   */
  place_m: [number, number, number] | null;
  probability: number;
}
/**
 * Candidates for a word of a person. `message`: problem of the rays, or empty.
 */
export interface Referents {
  /**
   * the most probable first
   */
  candidates: Referent[];
  /**
   * the effect, in one sentence for a person
   */
  message: string;
  /**
   * probability of none of these
   */
  none: number;
  /**
   * number of rays that count
   */
  rays: number;
}
/**
 * Deselect one object of any person: for a supervisor, or to take it over.
 */
export interface ReleaseObject {
  object_id: string;
  /**
   * select it at once for the requesting person
   */
  take_over: boolean;
}
/**
 * Remove all objects and start the feeders again.
 */
export interface ResetConveyor {}
/**
 * The way that a robot is about to take.
 */
export interface RobotPlan {
  /**
   * rest of its way, {W}, or empty if it goes nowhere
   */
  line_m: [number, number, number][];
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  /**
   * person for whom, or empty
   */
  user: string;
}
/**
 * Pose and activity of a robot, and the person who steers it; `stamp_ns` is that of the pose.
 */
export interface RobotState {
  /**
   * charge, if known
   */
  battery: number | null;
  /**
   * stamp of the goal that it carries out; 0: none
   */
  goal_ns: number;
  kind: "quadrotor" | "ground";
  phase: "landed" | "taking_off" | "idle" | "moving" | "landing" | "stopped" | "lost";
  /**
   * {W}; the last known one while it is lost
   *
   * @minItems 3
   * @maxItems 3
   */
  position_m: [number, number, number];
  /**
   * 1 sigma of the position along the worst direction, if known
   */
  position_sigma_m: number | null;
  /**
   * of the sphere, or upright cylinder, that it fills
   */
  radius_m: number;
  /**
   * why it does not move as asked, and the remedy; empty if it does
   */
  reason: string;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  /**
   * where it is sent, or None
   */
  target_m: [number, number, number] | null;
  /**
   * person who steers it, or empty
   */
  user: string;
  /**
   * {W}
   *
   * @minItems 3
   * @maxItems 3
   */
  velocity_mps: [number, number, number];
  yaw_rad: number;
}
/**
 * Replace the running scenario by another one, on the same site.
 */
export interface RunScenario {
  /**
   * locate people by pointing at lamps; None to keep the setting
   */
  localizes: boolean | null;
  /**
   * one of the deployment's
   */
  scenario: string;
  /**
   * number of people, or None to keep it
   */
  users: number | null;
}
/**
 * Tell a person something, by a cue with a text.
 */
export interface Say {
  text: string;
}
/**
 * An object that a person is about to select. To others it is not available.
 */
export interface ReservedObject {
  id: string;
  /**
   * free again then, unless held on
   */
  until_ns: number;
  user: string;
}
/**
 * One selected object.
 */
export interface SelectedObject {
  /**
   * probability that it was meant among nearby objects, or None
   */
  confidence: number | null;
  id: string;
  kind: string;
  since_ns: number;
  user: string;
}
/**
 * Everything that is selected now.
 */
export interface Selection {
  /**
   * time on an object that selects it, told where shards run, s
   */
  dwell_s: number | null;
  /**
   * method of selecting in use, told where shards run
   */
  method: string | null;
  objects: SelectedObject[];
  reserved: ReservedObject[];
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
}
/**
 * Send a robot to a place, in the name of the person, with the checks of a place pointed at.
 */
export interface SendRobot {
  /**
   * on the person's floor, {W}
   *
   * @minItems 3
   * @maxItems 3
   */
  position_m: [number, number, number];
  /**
   * empty: the one they have, or any if robots are not taken
   */
  robot: string;
}
/**
 * A request that a service has answered; `stamp_ns` is when it got it.
 */
export interface ServedRequest {
  instance: string;
  /**
   * JSON
   */
  query: string;
  /**
   * the reason, or empty if it was not refused
   */
  refusal: string;
  /**
   * JSON, or empty if it was refused or too large
   */
  reply: string;
  /**
   * key of the request
   */
  request: string;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  service: string;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
}
/**
 * Dim all strips, or some.
 */
export interface SetBrightness {
  brightness: number;
  /**
   * ids of strips, or empty for all
   */
  strips: string[];
}
/**
 * Start or stop the feeders. Belts run on, and packages can be added, either way.
 */
export interface SetFeeding {
  /**
   * false: they rest until it is true again, whatever a schedule's step says
   */
  feeding: boolean;
}
/**
 * The person points in a known direction right now: set the yaw of their pose by it.
 */
export interface SetHeading {
  /**
   * of that direction in {W}, such as towards a wall
   */
  azimuth_rad: number;
}
/**
 * Show a colour on a lamp that nobody needs to localize, until it is given back.
 */
export interface SetLamp {
  /**
   * None gives the lamp back
   */
  color: [number, number, number] | null;
}
/**
 * Choose how dwelling on an object selects it, and for how long. Without values it only reads them.
 */
export interface SetMethod {
  /**
   * time on an object that selects it; None for the method's default
   */
  dwell_s: number | null;
  /**
   * None to keep it
   */
  method: ("hold" | "fraction" | "gauge") | null;
  /**
   * any installed method, instead of `method`
   */
  name: string | null;
}
/**
 * The method in use now.
 */
export interface SetMethodReply {
  dwell_s: number;
  /**
   * all installed methods
   */
  installed: string[];
  /**
   * the effect, in one sentence for a person
   */
  message: string;
  /**
   * the method, or gauge (by angle) or hold (by metres) for that of another package
   */
  method: "hold" | "fraction" | "gauge";
  /**
   * the method; empty from version 1
   */
  name: string;
}
/**
 * Set the mounting of the sensor on the arm.
 */
export interface SetMounting {
  /**
   * it counts from the mounting in use, so rotates into the arm frame of today
   */
  is_relative: boolean;
  /**
   * rotates arm vectors into the sensor; None if as configured
   */
  sensor_from_arm_xyzw: [number, number, number, number] | null;
}
/**
 * The mounting in use now.
 */
export interface SetMountingReply {
  /**
   * the effect, in one sentence for a person
   */
  message: string;
  /**
   * @minItems 4
   * @maxItems 4
   */
  sensor_from_arm_xyzw: [number, number, number, number];
}
/**
 * A person's systematic error, fitted from pointing at known targets without a cursor (pointing.md §3).
 *
 * What is added to the model's ray: azimuth and elevation are polynomials in a, the ray's azimuth in {W}
 * less `reference_rad`, and e, its elevation, both taken before the correction.
 */
export interface PointingOffset {
  /**
   * pointings it was fitted from
   */
  anchors: number;
  /**
   * @minItems 6
   * @maxItems 6
   */
  azimuth: [number, number, number, number, number, number];
  /**
   * least and greatest a of the anchors; held there beyond them
   *
   * @minItems 2
   * @maxItems 2
   */
  azimuth_range_rad: [number, number];
  /**
   * @minItems 6
   * @maxItems 6
   */
  elevation: [number, number, number, number, number, number];
  /**
   * the same of e
   *
   * @minItems 2
   * @maxItems 2
   */
  elevation_range_rad: [number, number];
  /**
   * when, Unix ns
   */
  fitted_ns: number;
  /**
   * azimuth in {W} in the midst of the anchors
   */
  reference_rad: number;
  /**
   * pitch: only the constant of the elevation
   */
  rung: "pitch" | "polynomial";
  /**
   * 1 sigma of the elevation that is left, rad
   */
  sigma_rad: number;
}
/**
 * Keep a person's pointing offset.
 */
export interface SetOffset {
  /**
   * None removes it
   */
  offset: PointingOffset | null;
}
/**
 * Elevation bias of a person with one wearing of the sensor, from their localizations so far.
 *
 * The rays lie above their targets by `bias_rad` at the elevation -20 degrees, and by `slope` more per rad.
 */
export interface RememberedBias {
  bias_rad: number;
  /**
   * of (bias, slope), row by row, rad², rad, rad, 1
   *
   * @minItems 4
   * @maxItems 4
   */
  covariance: [number, number, number, number];
  /**
   * number of those that measured it
   */
  localizations: number;
  /**
   * of the sensor, see ImuSample
   */
  mounting: string;
  /**
   * height of the rays' origin over the feet
   */
  origin_height_m: number;
  slope: number;
}
/**
 * Set the pose of the person.
 */
export interface SetPose {
  /**
   * of a pose that is not exact
   */
  covariance: [number, number, number, number, number, number, number, number, number] | null;
  /**
   * found with it, see UserPose
   */
  elevation_bias_rad: number;
  /**
   * how it was found; with a covariance it is tracked as the IMU drifts
   */
  method: "fixed" | "static_targets" | "moving_target";
  /**
   * @minItems 3
   * @maxItems 3
   */
  position_m: [number, number, number];
  /**
   * of the localizer before; the remembered one stays if empty
   */
  remembered_bias: RememberedBias | null;
  yaw_rad: number;
}
/**
 * Set the conveyor's speed; 0 stops it, negative runs it backwards.
 */
export interface SetSpeed {
  /**
   * ids of belts, or empty for all
   */
  belts: string[];
  speed_mps: number;
}
/**
 * Fire a thing, or switch it, without pointing at it: for who tries it, or knows its true state.
 */
export interface SetThing {
  /**
   * state before a restart: nothing reacts
   */
  is_restored: boolean;
  /**
   * state of a switch; None toggles, or fires a button
   */
  on: boolean | null;
  thing: string;
}
/**
 * Choose how far a ray may pass its target. Without values it only reads the tolerance.
 */
export interface SetTolerance {
  /**
   * angle at the eyes; None to keep it
   */
  tolerance_rad: number | null;
}
/**
 * The tolerance in use now.
 */
export interface SetToleranceReply {
  /**
   * the effect, in one sentence for a person
   */
  message: string;
  /**
   * None if the tolerance is in metres
   */
  tolerance_rad: number | null;
}
/**
 * Choose a surface about a person on which their cursor moves, instead of the things of the map.
 */
export interface SetWorkspace {
  /**
   * point on the plane
   */
  anchor: "pointer" | "object" | "point";
  /**
   * none: the map; horizontal plane; vertical plane that faces the person; upright cylinder about the person; sphere about their eyes
   */
  kind: "none" | "horizontal" | "facing" | "cylinder" | "sphere";
  object_id: string;
  point_m: [number, number, number] | null;
}
/**
 * Turn a person's IMU so that it reads `yaw_rad` now.
 */
export interface SetYawOrigin {
  yaw_rad: number;
}
/**
 * Pixels of one strip in one colour.
 */
export interface LitPixels {
  /**
   * @minItems 3
   * @maxItems 3
   */
  color: [number, number, number];
  /**
   * of the strip
   */
  id: string;
  /**
   * Items: numbers on the strip
   */
  pixels: number[];
}
/**
 * Show these pixels on the strips, undimmed, and nothing else, for a while.
 */
export interface ShowPixels {
  /**
   * until they show cursors and objects again, s; 0: from now on
   */
  for_s: number;
  /**
   * all other pixels are dark
   */
  lit: LitPixels[];
}
/**
 * One spoken word.
 */
export interface Word {
  /**
   * of the recogniser; None if unknown
   */
  confidence: number | null;
  end_ns: number;
  /**
   * its onset, Unix ns of the site's time
   */
  start_ns: number;
  text: string;
}
/**
 * Words of one utterance of a person. `stamp_ns`: end of the last word, or the time of an empty one.
 */
export interface Speech {
  /**
   * false: the recogniser may still change them; nothing is done yet
   */
  is_final: boolean;
  /**
   * name of what recognised them
   */
  recogniser: string;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  words: Word[];
}
/**
 * Begin to localize a person.
 */
export interface StartLocalization {
  /**
   * None for the configured one
   */
  method: ("static_targets" | "moving_target") | null;
}
/**
 * A person's wish for a robot. The robot itself decides whom it obeys: see `RobotState.user`.
 */
export interface Steering {
  /**
   * robots that the person may point at; the likeliest first
   */
  candidates: Candidate[];
  /**
   * `follow`: to the person's cursor; `goals`: along their goals; `land`: at `target_m`, and then it is free; `none`: it stays
   */
  mode: "none" | "follow" | "goals" | "land";
  /**
   * that the person wants to steer, or empty
   */
  robot: string;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  /**
   * where to land, or None if it is where it hovers
   */
  target_m: [number, number, number] | null;
  /**
   * set so far, and not yet sent as a goal
   */
  waypoints_m: [number, number, number][];
}
/**
 * The person moved to the object beside the announced one, or to the nearest: by crown, swipe or key.
 */
export interface Step {
  /**
   * 1: the next object to the right in its row, -1: to the left
   */
  by: -1 | 1;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * device, page, headset, keyboard, simulated
   */
  source: string;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
}
/**
 * Stop a robot: nobody steers it any more until somebody takes it again. Not a safety function.
 */
export interface StopRobot {
  /**
   * why, in a few words, for who steers it
   */
  reason: string;
}
/**
 * The pixels of one strip.
 */
export interface StripFrame {
  id: string;
  /**
   * 3 bytes a pixel, red green blue, pixel 0 first
   */
  rgb: Uint8Array;
}
/**
 * The pixels of every strip; `stamp_ns`: when the newest cursor new in it was captured, else its own.
 */
export interface StripsFrame {
  /**
   * from this message to the light of the slowest controller that changes, as measured at the last change, wall time
   */
  light_s: number;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  strips: StripFrame[];
}
/**
 * An object with a known position: a package, a segment, a robot.
 */
export interface TrackedObject {
  /**
   * its destination; empty if undecided or none
   */
  bay: string;
  /**
   * until then, at the present speeds, (de)selecting it changes its bay; 0: it is too late; None if no limit is known
   */
  bay_until_ns: number | null;
  /**
   * time on it that selects it, s; the method's if empty
   */
  dwell_s: number | null;
  id: string;
  kind: string;
  /**
   * extent along its surface, or diameter
   */
  length_m: number;
  /**
   * a light shows people that they point at it
   */
  lit: boolean;
  mode: "claim" | "button" | "switch";
  /**
   * its centre at the message's stamp, {W}
   *
   * @minItems 3
   * @maxItems 3
   */
  position_m: [number, number, number];
  /**
   * 1 sigma of the position along the worst direction, if known
   */
  position_sigma_m: number | null;
  /**
   * selected by pressing while pointing at it only
   */
  press: boolean;
  /**
   * of its upright box, turned by `yaw_rad`; only its length counts if empty
   */
  size_m: [number, number, number] | null;
  surface: "none" | "strip" | "belt" | "lamp" | "points";
  surface_id: string;
  /**
   * arc length of its centre on the surface
   */
  surface_position_m: number;
  /**
   * along the surface, signed
   */
  surface_speed_mps: number;
  /**
   * {W}
   *
   * @minItems 3
   * @maxItems 3
   */
  velocity_mps: [number, number, number];
  /**
   * azimuth of its front, if it has one
   */
  yaw_rad: number | null;
}
/**
 * All tracked objects of one tracker at one time. An object that is no longer listed has left.
 */
export interface TrackedObjects {
  /**
   * 1 sigma of the time from `stamp_ns` to that of the positions; None if unknown
   */
  latency_sigma_s: number | null;
  objects: TrackedObject[];
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
}
/**
 * Meaning of an utterance, and the result. `stamp_ns`: that of the speech.
 */
export interface Understood {
  /**
   * verb of the command, or empty if it is none
   */
  command: string;
  /**
   * result, in one sentence for a person
   */
  message: string;
  /**
   * of its words, in their order
   */
  referents: Referent[];
  result: "done" | "asked" | "refused" | "ignored";
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  /**
   * the words
   */
  text: string;
}
/**
 * Undo the last selection or deselection of a person.
 */
export interface UndoSelection {}
/**
 * Use another map, or the same file again after it has changed. Without a path only tell which it is.
 */
export interface UseMap {
  /**
   * shipped map, or path on pui's machine; empty to keep it
   */
  path: string;
}
/**
 * The map in use now.
 */
export interface UseMapReply {
  /**
   * the effect, in one sentence for a person
   */
  message: string;
  /**
   * shipped map, or absolute path on pui's machine
   */
  path: string;
}
/**
 * {H} in {W}: where the person stands and how their IMU's yaw origin lies in the room.
 */
export interface UserPose {
  /**
   * last time at which pointing at a known point determined the pose; 0 if never
   */
  anchored_ns: number;
  /**
   * of (x, y, yaw of pointing), row by row, m², m·rad, rad²
   *
   * @minItems 9
   * @maxItems 9
   */
  covariance: [number, number, number, number, number, number, number, number, number];
  /**
   * the person's rays lie higher by it: subtract it before casting
   */
  elevation_bias_rad: number;
  method: "fixed" | "static_targets" | "moving_target" | "external";
  /**
   * @minItems 3
   * @maxItems 3
   */
  position_m: [number, number, number];
  /**
   * elevation bias that the next localization by a robot expects, None if unknown
   */
  remembered_bias: RememberedBias | null;
  /**
   * rms angle between rays and targets
   */
  residual_rad: number;
  samples: number;
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  /**
   * azimuth of {H}'s x axis in {W}
   */
  yaw_rad: number;
  /**
   * rate of `yaw_rad` due to the IMU's yaw drift
   */
  yaw_rate_radps: number;
  /**
   * its 1 sigma, or None if not estimated
   */
  yaw_rate_sigma_radps: number | null;
  /**
   * 1 sigma of the height; 0: the floor is known
   */
  z_sigma_m: number;
}
/**
 * Lengths of the pointing model, metres; defaults as in the ROS 2 toolkit (eyes at 1.64 m).
 */
export interface BodyMeasures {
  footprint_to_neck_m: number;
  neck_to_eyes_m: number;
  neck_to_shoulder_m: number;
  shoulder_to_wrist_m: number;
  wrist_to_finger_m: number;
}
/**
 * Profile of the person: body measures, handedness, colour of the cursor.
 */
export interface UserProfile {
  body: BodyMeasures;
  /**
   * @minItems 3
   * @maxItems 3
   */
  cursor_color: [number, number, number];
  /**
   * of the cursor by distance, such as viridis, or empty
   */
  cursor_colormap: string;
  /**
   * length lit on a strip
   */
  cursor_width_m: number;
  hand: "left" | "right";
  /**
   * None if not calibrated
   */
  offset: PointingOffset | null;
  /**
   * mark of this person's things, besides the colour
   */
  pattern: "solid" | "dashed" | "dotted" | "striped" | "hollow" | "tailed";
  /**
   * from the eyes through the fingertip, from the shoulder or from the elbow
   */
  ray_model: "eye_finger" | "shoulder_arm" | "forearm";
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
}
/**
 * Orientation of a person's hand as a page reports it: of the arm that a mouse moves, or of a phone.
 *
 * Sent at least five times a second while the page controls the person's wrist, moving or not.
 */
export interface WristSample {
  /**
   * charge left, 0 to 1
   */
  battery: number | null;
  /**
   * arm: x along the arm to the finger, the frame is {H}; phone: x to the right of its screen, y to its top, the frame's yaw is its own
   */
  device: "arm" | "phone";
  /**
   * the device's own clock, ns
   */
  device_time_ns: number | null;
  /**
   * rotates vectors of the device into a frame whose z is up
   *
   * @minItems 4
   * @maxItems 4
   */
  orientation_xyzw: [number, number, number, number];
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * another number: the device may have another yaw origin than before
   */
  session: number;
  /**
   * headset, which measures the arm; a mouse or ROS if empty
   */
  source: string;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
}
