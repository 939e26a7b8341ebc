// The bus's messages, from schemas/catalogue. Written by `npm run types`; do not edit.

export interface Everything {
  AddPackage: AddPackage;
  AddPackageReply: AddPackageReply;
  Anchor: Anchor;
  ButtonEvent: ButtonEvent;
  CancelLocalization: CancelLocalization;
  ClearSelection: ClearSelection;
  ClockTick: ClockTick;
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
  Lamp: Lamp;
  Plane: Plane;
  Sphere: Sphere;
  Strip: Strip;
  Environment: Environment;
  Feedback: Feedback;
  Goal: Goal;
  Figure: Figure;
  KeyHealth: KeyHealth;
  Quantiles: Quantiles;
  Health: Health;
  Hover: Hover;
  ImuSample: ImuSample;
  Interaction: Interaction;
  LampColor: LampColor;
  Candidate: Candidate;
  Localization: Localization;
  PointAnchor: PointAnchor;
  PointingRay: PointingRay;
  ReadHistory: ReadHistory;
  SelectionEvent: SelectionEvent;
  ReadHistoryReply: ReadHistoryReply;
  ReleaseObject: ReleaseObject;
  ResetConveyor: ResetConveyor;
  RunScenario: RunScenario;
  ReservedObject: ReservedObject;
  SelectedObject: SelectedObject;
  Selection: Selection;
  SetBrightness: SetBrightness;
  SetFeeding: SetFeeding;
  SetHeading: SetHeading;
  SetMethod: SetMethod;
  SetMethodReply: SetMethodReply;
  SetMounting: SetMounting;
  SetMountingReply: SetMountingReply;
  PointingOffset: PointingOffset;
  SetOffset: SetOffset;
  SetPose: SetPose;
  SetSpeed: SetSpeed;
  SetTolerance: SetTolerance;
  SetToleranceReply: SetToleranceReply;
  SetWorkspace: SetWorkspace;
  SetYawOrigin: SetYawOrigin;
  StartLocalization: StartLocalization;
  StripFrame: StripFrame;
  StripsFrame: StripsFrame;
  TrackedObject: TrackedObject;
  TrackedObjects: TrackedObjects;
  UndoSelection: UndoSelection;
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
   * strip or belt id; empty: the first lane
   */
  lane: string;
  length_m: number;
  /**
   * share of the lane's length from its start; empty: where packages come onto it
   */
  position: number | null;
}
/**
 * The object's id.
 */
export interface AddPackageReply {
  /**
   * one sentence for a person: what was done
   */
  message: string;
  object_id: string;
}
/**
 * One pointing at a known place without a cursor: what tells a person's offset and an IMU's drift.
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
   * the same with the person's offset taken out
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
   * why it was not, and what to do
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
   * lamp or object; empty: a direction only
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
 * The person pressed their button; presses move the interaction on.
 */
export interface ButtonEvent {
  gesture: "press" | "double" | "hold";
  /**
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * device, page, keyboard, joypad, simulated
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
export interface CancelLocalization {}
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
 * What came out at a bay.
 */
export interface BayCount {
  bay: string;
  count: number;
  kind: string;
  /**
   * of these, how many were selected
   */
  selected: number;
}
/**
 * How fast one belt runs.
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
   * empty: where a belt ends
   */
  bay: string;
  object_id: string;
  stamp_ns: number;
  /**
   * for whom it was sent there; empty: nobody
   */
  user: string;
}
/**
 * What the conveyor does.
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
   * false: the feeders rest until they are let again
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
   * of a feeding schedule; empty: there is none
   */
  step: string;
}
/**
 * How far the ray passes a lamp.
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
 * Where the pointing ray meets the environment, in {W}.
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
  service: string;
  user: string;
}
/**
 * What `pointit run` or `pointit user` started; lets `doctor` tell what is missing.
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
   * that runs; empty: none that has a name
   */
  scenario: string;
  /**
   * that it can run instead when asked to; empty: it takes no such wish
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
   * kinds of objects to select; empty: none is wrong
   */
  target_kinds: string[];
}
/**
 * It was done.
 */
export interface Done {
  /**
   * one sentence for a person: what was done
   */
  message: string;
}
/**
 * Where objects leave the conveyor: the end of a belt.
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
   * arc length on `source` where they leave it; empty: its end
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
 * A point cloud, read from a file by whoever casts; only what it is travels.
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
   * along u and v; empty: without end
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
 * The map of the room in {W}; the ROS toolkit's `belts`, `leds`, `strips`, `links`, and more.
 */
export interface Environment {
  bays: Bay[];
  belts: Belt[];
  boxes: Box[];
  clouds: Cloud[];
  cylinders: Cylinder[];
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
}
/**
 * A cue for the person's senses.
 */
export interface Feedback {
  /**
   * what is to be heard
   */
  chime: "" | "up" | "down" | "single" | "double" | "buzz" | "tick" | "tock";
  /**
   * what a state lamp is to show for a moment
   */
  color: [number, number, number] | null;
  cue: "started" | "stopped" | "target" | "localized" | "refused" | "selected" | "deselected";
  /**
   * what is to be felt: on, off, on ..., ms; empty: nothing
   */
  haptic_ms: number[];
  /**
   * the place that it is about, {W}; empty: none
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
   * what the person is asked to point at
   */
  target_id: string;
  text: string;
  /**
   * how far to turn, right and up, of one who points past everything; else empty
   */
  turn_rad: [number, number] | null;
  /**
   * there is nothing to do yet but wait for the next cue
   */
  waits: boolean;
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
   * on the floor from the place to the nearest person whose place is known
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
   * counts this writer's messages on this key
   */
  seq: number;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  /**
   * level plane of the map it is on, or `workspace/horizontal`; empty: unknown
   */
  surface_id: string;
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
   * since the newest; empty when there was none
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
 * Median and 99th percentile, seconds, over the last second.
 */
export interface Quantiles {
  p50_s: number;
  p99_s: number;
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
   * what else it measures
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
   * what is wrong and what to do
   */
  warnings: string[];
}
/**
 * The object under the person's cursor and how far its selection has come.
 */
export interface Hover {
  /**
   * what staying there would do
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
   * where the cursor is drawn to, {W}; the true one is the cursor's
   */
  snapped_m: [number, number, number] | null;
  /**
   * the same along the cursor's surface; empty: not drawn to anything
   */
  snapped_position_m: number | null;
  /**
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
  /**
   * who else has it selected, or is about to
   */
  taken_by: string;
}
/**
 * Orientation of the arm: rotates vectors of the arm frame (x along the arm to the finger) into {H}.
 *
 * {H} is at the person's feet, z up, x forward at IMU yaw 0. The mounting of the sensor on the arm is
 * already taken out by whoever publishes.
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
   * counts how often the yaw origin was set anew, by a request, a new mounting or a restarted device
   */
  yaw_epoch: number;
}
/**
 * Where the person is in the interaction's life cycle (paper, §II-D), and what they should do next.
 */
export interface Interaction {
  /**
   * who is to be localized first, in turn; empty: nobody, or no wish to be
   */
  ahead: string[];
  /**
   * the person's direction has become uncertain: a double press, then pointing at a lamp once, sets it right
   */
  is_unsure: boolean;
  /**
   * one sentence for the person
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
 * What a single lamp shows; black is off.
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
 * A thing that may be meant, and how probably.
 */
export interface Candidate {
  object_id: string;
  probability: number;
}
/**
 * Progress of one localization, as the person and a dashboard should see it.
 */
export interface Localization {
  /**
   * who uses the lamps, who is before them; then they wait, not sampling
   */
  ahead: string[];
  /**
   * of several robots, which may be meant; the likeliest first
   */
  candidates: Candidate[];
  phase: "idle" | "sampling" | "solved" | "refused" | "cancelled";
  /**
   * 1 sigma along the worse direction, so far; empty: unknown
   */
  position_sigma_m: number | null;
  progress: number;
  /**
   * to find the pose, or to set one right by pointing at one known place
   */
  purpose: "pose" | "anchor";
  /**
   * why it was refused and what to do
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
   * lamp or robot to point at now; empty when none
   */
  target_id: string;
  target_index: number;
  /**
   * 1 sigma so far; empty: unknown
   */
  yaw_sigma_rad: number | null;
}
/**
 * Have the person point at one lamp without a cursor, to set their pose right.
 */
export interface PointAnchor {
  /**
   * its id; empty: the one that tells most
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
   * filtered, the person's offset taken out
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
   * 1 sigma of the person's elevation error that is left; empty: not calibrated
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
 * Ask for the last selection events that the selector told, from its journal.
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
   * what the person did; empty: nothing, or unknown
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
   * who did it; of `left` and `dispatched`: for whom it went there, or empty
   */
  user: string;
}
/**
 * What was told, as far as there is room: the oldest are left out.
 */
export interface ReadHistoryReply {
  /**
   * the latest last; number, stamp, object and event are those of the message then
   */
  events: SelectionEvent[];
  /**
   * one sentence for a person: what was done
   */
  message: string;
}
/**
 * Deselect one object, whoever selected it: for a supervisor, or to take it over.
 */
export interface ReleaseObject {
  object_id: string;
  /**
   * select it for the person who asks at once
   */
  take_over: boolean;
}
/**
 * Take every object off and start the feeders again.
 */
export interface ResetConveyor {}
/**
 * End what runs and run another scenario in its place, on the same site.
 */
export interface RunScenario {
  /**
   * find people by their pointing at lamps; empty: as now
   */
  localizes: boolean | null;
  /**
   * one of the deployment's
   */
  scenario: string;
  /**
   * how many people; empty: as now
   */
  users: number | null;
}
/**
 * An object that somebody is about to select; others see it as taken.
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
   * that it was meant, of all that was near; empty: unknown
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
 * Dim all strips, or some.
 */
export interface SetBrightness {
  brightness: number;
  /**
   * ids of strips; empty: all of them
   */
  strips: string[];
}
/**
 * Let the feeders give packages, or rest; belts run on, and packages can be added, either way.
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
 * Choose how staying on an object selects it, and for how long; with nothing set it only asks.
 */
export interface SetMethod {
  /**
   * time on an object that selects it; empty: the method's own
   */
  dwell_s: number | null;
  /**
   * empty: as it is
   */
  method: ("hold" | "fraction" | "gauge") | null;
}
/**
 * What is in use now.
 */
export interface SetMethodReply {
  dwell_s: number;
  /**
   * one sentence for a person: what was done
   */
  message: string;
  method: "hold" | "fraction" | "gauge";
}
/**
 * Say how the sensor sits on the arm.
 */
export interface SetMounting {
  /**
   * it counts from the mounting in use, so rotates into the arm frame of today
   */
  is_relative: boolean;
  /**
   * rotates arm vectors into the sensor; empty: as configured
   */
  sensor_from_arm_xyzw: [number, number, number, number] | null;
}
/**
 * What is in use now.
 */
export interface SetMountingReply {
  /**
   * one sentence for a person: what was done
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
   * empty: forget it
   */
  offset: PointingOffset | null;
}
/**
 * Say where the person stands.
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
   * how it was found; with a covariance it is followed as the IMU drifts
   */
  method: "fixed" | "static_targets" | "moving_target";
  /**
   * @minItems 3
   * @maxItems 3
   */
  position_m: [number, number, number];
  yaw_rad: number;
}
/**
 * Set the conveyor's speed; 0 stops it, negative runs it backwards.
 */
export interface SetSpeed {
  /**
   * ids of belts; empty: all of them
   */
  belts: string[];
  speed_mps: number;
}
/**
 * Choose how far a ray may pass things that it still points at; with nothing set it only asks.
 */
export interface SetTolerance {
  /**
   * angle at the eyes; empty: as it is
   */
  tolerance_rad: number | null;
}
/**
 * What is in use now.
 */
export interface SetToleranceReply {
  /**
   * one sentence for a person: what was done
   */
  message: string;
  /**
   * empty: metres tell what is near enough
   */
  tolerance_rad: number | null;
}
/**
 * Choose a surface about a person on which their cursor moves, instead of the things of the map.
 */
export interface SetWorkspace {
  /**
   * through what it is laid
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
 * Begin to localize a person.
 */
export interface StartLocalization {
  /**
   * empty: as configured
   */
  method: ("static_targets" | "moving_target") | null;
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
   * from this message to the slowest controller's light, as last measured, wall time
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
 * A thing whose place is known: a package, a segment, a robot.
 */
export interface TrackedObject {
  /**
   * where it is on its way to; empty: not decided, or nowhere
   */
  bay: string;
  /**
   * until then, at the present speeds, (de)selecting it changes its bay; 0: it is too late; empty: no limit is known
   */
  bay_until_ns: number | null;
  id: string;
  kind: string;
  /**
   * extent along its surface, or diameter
   */
  length_m: number;
  /**
   * its centre at the message's stamp, {W}
   *
   * @minItems 3
   * @maxItems 3
   */
  position_m: [number, number, number];
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
}
/**
 * All tracked objects of one tracker at one time; an object that is no longer listed has left.
 */
export interface TrackedObjects {
  /**
   * 1 sigma of the time from `stamp_ns` to that of the positions; empty: unknown
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
 * Take back the last selection or deselection of a person.
 */
export interface UndoSelection {}
/**
 * {H} in {W}: where the person stands and how their IMU's yaw origin lies in the room.
 */
export interface UserPose {
  /**
   * when pointing at a known place last told the pose; 0: never
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
   * how fast `yaw_rad` changes because the IMU's yaw drifts
   */
  yaw_rate_radps: number;
  /**
   * its 1 sigma; empty: not estimated
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
 * Who the person is to the system: body measures, handedness, colour of the cursor.
 */
export interface UserProfile {
  body: BodyMeasures;
  /**
   * @minItems 3
   * @maxItems 3
   */
  cursor_color: [number, number, number];
  /**
   * of the cursor by distance, such as viridis; empty: its colour
   */
  cursor_colormap: string;
  /**
   * length lit on a strip
   */
  cursor_width_m: number;
  hand: "left" | "right";
  /**
   * empty: not calibrated
   */
  offset: PointingOffset | null;
  /**
   * second sign of what is this person's, beside the colour
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
 * Orientation of a person's hand as a page reports it: of the arm a mouse moves, or of a phone.
 *
 * Comes at least five times a second as long as the page has the person's wrist, be it moved or not.
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
   * time of capture, Unix ns; derived data keep it
   */
  stamp_ns: number;
}
