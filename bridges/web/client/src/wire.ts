// What travels between server and page, from wire.json. Written by `npm run types`; do not edit.

export interface Everything {
  Ack: Ack;
  AimAt: AimAt;
  Answer: Answer;
  Ask: Ask;
  AssumedPlace: AssumedPlace;
  Cue: Cue;
  DeviceLine: DeviceLine;
  FindingLine: FindingLine;
  HeadsetMotion: HeadsetMotion;
  Hello: Hello;
  Lane: Lane;
  PersonLine: PersonLine;
  Play: Play;
  Playing: Playing;
  ScanBegin: ScanBegin;
  ScanLight: ScanLight;
  ScanLook: ScanLook;
  ScanRoom: ScanRoom;
  ScanRoomStrip: ScanRoomStrip;
  ScanSave: ScanSave;
  ScanState: ScanState;
  ScanStrip: ScanStrip;
  ScanThing: ScanThing;
  ScanUndo: ScanUndo;
  ScanView: ScanView;
  ServiceLine: ServiceLine;
  SpaceAlignment: SpaceAlignment;
  Status: Status;
  Timeline: Timeline;
  Turn: Turn;
}
/**
 * Acknowledgement that a batch was shown.
 */
export interface Ack {
  kind: "ack";
  /**
   * from the capture at the wrist to this frame
   */
  latency_ms: number | null;
  n: number;
}
/**
 * Point of the mouse, {W}.
 */
export interface AimAt {
  /**
   * @minItems 3
   * @maxItems 3
   */
  at_m: [number, number, number];
  kind: "aim";
  user: string;
}
/**
 * Result of an `Ask`.
 */
export interface Answer {
  /**
   * reason of the refusal; empty if done
   */
  error: string;
  id: number;
  kind: "answer";
  /**
   * fields of the reply; empty if refused
   */
  reply: {
    [k: string]: unknown;
  } | null;
}
/**
 * Request of the table by its key pattern, or a deed of this server.
 */
export interface Ask {
  deed:
    | (
        | "press"
        | "step"
        | "take"
        | "give"
        | "tremor"
        | "pair"
        | "open_lan"
        | "find_devices"
        | "connect_device"
        | "forget_device"
        | "show_device"
        | "check_mounting"
        | "told_apart"
        | "centre"
        | "speak"
        | "map_room"
        | "read_map"
        | "check_map"
        | "save_map"
      )
    | null;
  id: number;
  /**
   * of the table of requests; empty for a deed
   */
  key: string;
  kind: "ask";
  /**
   * user or other placeholder of the key
   */
  name: string;
  /**
   * fields of the query
   */
  query: {
    [k: string]: unknown;
  };
}
/**
 * A person's assumed pose.
 */
export interface AssumedPlace {
  /**
   * of their feet in {W}, m
   *
   * @minItems 3
   * @maxItems 3
   */
  position_m: [number, number, number];
  /**
   * azimuth of {H}'s x axis in {W}, rad
   */
  yaw_rad: number;
}
/**
 * Cue for a phone's person: a `Feedback` of the bus, or the state of the interaction.
 */
export interface Cue {
  /**
   * name of a thing to speak now; empty if there is none
   */
  announced: string;
  chime: string;
  haptic_ms: number[];
  /**
   * the arm no longer follows this phone
   */
  has_lost_arm: boolean;
  /**
   * names of things are spoken to the person
   */
  has_names: boolean;
  kind: "cue";
  next_step: string;
  /**
   * of pointing at targets; empty if there are none
   */
  progress: number | null;
  state: string;
  text: string;
  /**
   * a double press does what the next step asks for
   */
  wants_double: boolean;
}
/**
 * A wrist or light that pages have connected.
 */
export interface DeviceLine {
  address: string;
  id: string;
  /**
   * its process runs
   */
  is_on: boolean;
  kind: "wrist" | "light";
  /**
   * model, name and the like
   */
  label: string;
  /**
   * of the person or strip
   */
  name: string;
  /**
   * of a light; 0 if it does not say
   */
  pixels: number;
  /**
   * name of its plug-in
   */
  plugin: string;
  /**
   * reason why it does not work; empty if it does
   */
  problem: string;
  /**
   * last line of the check of its mounting, while that runs
   */
  said: string;
}
/**
 * A finding and its remedy.
 */
export interface FindingLine {
  /**
   * from the outage of the whole site, a finding itself
   */
  follows: boolean;
  remedy: string;
  sentence: string;
  service: string;
  severity: "error" | "warning" | "note";
}
/**
 * Head and hand of a headset's wearer, in the space of its session, z up.
 */
export interface HeadsetMotion {
  /**
   * empty before the alignment; then nothing moves
   */
  alignment: SpaceAlignment | null;
  /**
   * @minItems 3
   * @maxItems 3
   */
  eyes_m: [number, number, number];
  kind: "headset";
  /**
   * tip of the hand or controller; empty if it is not tracked
   */
  tip_m: [number, number, number] | null;
  user: string;
}
/**
 * The space of a headset's session, z up, in {W}.
 */
export interface SpaceAlignment {
  /**
   * @minItems 3
   * @maxItems 3
   */
  origin_m: [number, number, number];
  /**
   * azimuth of its x axis
   */
  yaw_rad: number;
}
/**
 * Greeting: the page's role and rights.
 */
export interface Hello {
  deeds: (
    | "press"
    | "step"
    | "take"
    | "give"
    | "tremor"
    | "pair"
    | "open_lan"
    | "find_devices"
    | "connect_device"
    | "forget_device"
    | "show_device"
    | "check_mounting"
    | "told_apart"
    | "centre"
    | "speak"
    | "map_room"
    | "read_map"
    | "check_map"
    | "save_map"
  )[];
  kind: "hello";
  /**
   * of a phone: lamps of the map
   */
  lamps: string[];
  /**
   * keys of the requests that this page may make
   */
  requests: string[];
  role: "operator" | "viewer" | "wrist";
  site: string;
  /**
   * names of things are spoken here, unless the person chose otherwise
   */
  speaks: boolean;
  /**
   * of a phone, or a page in its browser: whose wrist it is
   */
  user: string;
  /**
   * of PointIt
   */
  version: string;
}
/**
 * One row of a timeline.
 */
export interface Lane {
  /**
   * start and end, s from the beginning, equal for an instant; and a text
   */
  items: [number, number, string][];
  kind: "interaction" | "robot" | "hover" | "selections" | "refusals" | "wrong" | "misses" | "warnings";
  /**
   * person or robot; empty if it is of the site
   */
  user: string;
}
/**
 * A person who is present.
 */
export interface PersonLine {
  /**
   * until they have a pose; empty if none is configured
   */
  assumed: AssumedPlace | null;
  battery: number | null;
  /**
   * by this page
   */
  is_mine: boolean;
  moved_by: "own" | "mouse" | "phone" | "headset";
  /**
   * state of the paired phone; empty if none is paired
   */
  phone: string;
  user: string;
}
/**
 * Control of a page's playback. Fields that are missing do not change anything.
 */
export interface Play {
  /**
   * where to go, from the beginning
   */
  at_s: number | null;
  is_playing: boolean | null;
  kind: "play";
  speed: number | null;
  /**
   * to the message before or after, and pause
   */
  step: -1 | 0 | 1;
}
/**
 * Position of a playback.
 */
export interface Playing {
  /**
   * from the beginning, now
   */
  at_s: number;
  /**
   * the position was set
   */
  has_jumped: boolean;
  is_playing: boolean;
  kind: "playing";
  speed: number;
}
/**
 * Begin, or begin again: all views are forgotten.
 */
export interface ScanBegin {
  /**
   * true if the lamps of the map blink, too
   */
  has_lamps: boolean;
  kind: "begin";
  /**
   * from its first to its last pixel
   */
  known_m: number | null;
  /**
   * a strip of known length, or empty
   */
  known_strip: string;
  /**
   * by strip; empty if unknown
   */
  leds_per_m: {
    [k: string]: number;
  };
}
/**
 * Show the lights in colours for a while, or give them back if there are none.
 */
export interface ScanLight {
  brightness: number;
  /**
   * 0 red, 1 green, 2 blue, of each of `ScanState.lights`; empty if all are dark
   */
  colors: number[] | null;
  kind: "light";
}
/**
 * Ask for the state.
 */
export interface ScanLook {
  kind: "look";
}
/**
 * The room of a simulated camera.
 */
export interface ScanRoom {
  /**
   * places from which the camera looks, in turn
   */
  places_m: [number, number, number][];
  strips: ScanRoomStrip[];
}
/**
 * A strip, or a lamp of one pixel, as a simulated camera sees it.
 */
export interface ScanRoomStrip {
  name: string;
  /**
   * of its pixels
   */
  places_m: [number, number, number][];
}
/**
 * Write the map: x from the first to the last pixel of `origin`, z = 0 at the lowest light.
 */
export interface ScanSave {
  kind: "save";
  /**
   * of the file, without a folder
   */
  name: string;
  /**
   * strip, or empty for any
   */
  origin: string;
}
/**
 * State of the scan.
 */
export interface ScanState {
  advice: string;
  /**
   * of the views that could be placed
   */
  cameras_m: [number, number, number][];
  /**
   * suggested name of the map
   */
  file: string;
  /**
   * both ends of every strip are known to 1 cm
   */
  is_complete: boolean;
  is_simulated: boolean;
  is_solving: boolean;
  kind: "scan";
  /**
   * strip and pixel of each marked light
   */
  lights: [string, number][];
  /**
   * place of the camera for the next view; empty if none is advised
   */
  next_m: [number, number, number] | null;
  problem: string;
  /**
   * path of the written map as pages show it; empty if none
   */
  saved: string;
  strips: ScanStrip[];
  /**
   * taken so far
   */
  views: number;
}
/**
 * A strip, its line as far as it is known; or a lamp: one pixel, a line of one point.
 *
 * Or a thing that was tapped: no pixels, a line of its corners.
 */
export interface ScanStrip {
  /**
   * in the map in use, which may be wrong
   */
  leds_per_m: number | null;
  /**
   * from the first pixel on; empty if unknown
   */
  line_m: [number, number, number][];
  name: string;
  pixels: number;
  /**
   * why it is unknown; empty if it is known
   */
  reason: string;
  /**
   * number of views that show it
   */
  seen: number;
  /**
   * of its worse end; empty if unknown
   */
  sigma_m: number | null;
}
/**
 * A thing by its corners, or none to forget it: each in two views or more, view (from 0) and position.
 *
 * A box: three corners of its top, one after the other, and one of its foot. Others: three corners.
 */
export interface ScanThing {
  corners: [number, number, number][][];
  kind: "thing";
  name: string;
  shape: "box" | "screen" | "table";
}
/**
 * Forget the last view.
 */
export interface ScanUndo {
  kind: "undo";
}
/**
 * A view: lights by their index in `ScanState.lights`, and image positions, pixels right and down.
 */
export interface ScanView {
  /**
   * unit vector of down; x right, y down, z ahead in the picture
   */
  gravity: [number, number, number] | null;
  height: number;
  kind: "view";
  seen: [number, number, number][];
  width: number;
}
/**
 * A service that is, was or should be present.
 */
export interface ServiceLine {
  instance: string;
  present: boolean;
  /**
   * time up or down, s of wall time
   */
  since_s: number;
}
/**
 * Status of the site beyond its topics.
 */
export interface Status {
  devices: DeviceLine[];
  findings: FindingLine[];
  kind: "status";
  /**
   * address in the local network; empty if closed
   */
  lan_url: string;
  people: PersonLine[];
  /**
   * `starts`: services of another scenario are missing yet; `over`: ended on purpose
   */
  run: "runs" | "starts" | "over";
  services: ServiceLine[];
  viewers: number;
}
/**
 * Contents of a page's playback.
 */
export interface Timeline {
  /**
   * site time of its beginning
   */
  began_ns: number;
  kind: "timeline";
  lanes: Lane[];
  length_s: number;
  /**
   * problem of the file, or empty
   */
  problem: string;
  /**
   * lanes are complete, and seeks possible, until then
   */
  read_s: number;
  /**
   * name of the file, or empty for the past of a running site
   */
  title: string;
}
/**
 * The orientation of a phone.
 */
export interface Turn {
  battery: number | null;
  kind: "turn";
  /**
   * @minItems 4
   * @maxItems 4
   */
  q: [number, number, number, number];
  session: number;
  /**
   * the phone's own clock
   */
  t_ms: number;
}
