/** State of the site: the newest message of every key, and the server's status. */

import type {
  Announced,
  ConveyorState,
  Cursor,
  Deployment,
  Environment,
  Feedback,
  Goal,
  Health,
  Hover,
  Interaction,
  LampColor,
  Localization,
  Selection,
  SelectionEvent,
  SelectionManner,
  Steering,
  StripsFrame,
  ThingStates,
  TrackedObject,
  TrackedObjects,
  Understood,
  UserPose,
  UserProfile,
} from "../messages";
import type { Robot } from "./robots";
import type { Hello, PersonLine, Playing, Status, Timeline } from "../wire";

/** All that is known of one person. */
export interface Person {
  readonly user: string;
  profile: UserProfile | null;
  pose: UserPose | null;
  cursor: Cursor | null;
  /** `performance.now()` when the newest cursor came; an old one is not drawn. */
  cursorAt: number;
  hover: Hover | null;
  /** Thing whose name is spoken to them. */
  announced: Announced | null;
  interaction: Interaction | null;
  localization: Localization | null;
  /** What they said last, and what became of it. */
  understood: Understood | null;
  /** Where they sent a robot last. */
  goal: Goal | null;
  /** Where they may send one, if they confirm it. */
  proposed: [number, number, number] | null;
  /** Which robot they want to steer, and how. */
  steering: Steering | null;
  /** What the server says: who moves the wrist. */
  line: PersonLine | null;
}

/** One line of the message log. */
export interface LogLine {
  /** Number of lines before it since the page was opened. */
  id: number;
  /** Unix time, ms. */
  at: number;
  severity: "info" | "warning" | "error";
  /** Whose it is: a user, a service, or empty. */
  who: string;
  text: string;
}

/** The site as of now; changed in place by `connection.ts`, read by views and panels once a frame. */
export interface Site {
  hello: Hello | null;
  status: Status | null;
  /** Of a page that plays the past; null: it shows the present. */
  timeline: Timeline | null;
  playing: Playing | null;
  /** Open, or since when (`performance.now()`) not. */
  connected: boolean;
  lostAt: number;
  /** Counts maps: a view rebuilds its scene when it has changed. */
  mapVersion: number;
  map: Environment | null;
  /** Only people who are there now. */
  readonly people: Map<string, Person>;
  /** By tracker. */
  readonly objects: Map<string, TrackedObjects>;
  /** The last selection, deselection and refusal of each object, by its id; those of before this page came, too. `last` is no refusal. */
  readonly changes: Map<
    string,
    {
      selected?: SelectionEvent;
      deselected?: SelectionEvent;
      refused?: SelectionEvent;
      last?: SelectionEvent;
    }
  >;
  /** By name. */
  readonly robots: Map<string, Robot>;
  selection: Selection | null;
  /** How people select here. */
  manner: SelectionManner | null;
  strips: StripsFrame | null;
  /** By lamp id. */
  readonly lamps: Map<string, LampColor>;
  conveyor: ConveyorState | null;
  /** By instance. */
  readonly health: Map<string, Health>;
  /** Things of each carrier, with their states. */
  readonly carriers: Map<string, ThingStates>;
  /** Deployments by name. */
  readonly deployments: Map<string, Deployment>;
  /** Events since the frame before, in order; for views that show them. Emptied after each frame. */
  readonly fresh: SiteEvent[];
  /** Newest last, at most `LOG_LINES`. */
  readonly log: LogLine[];
  /** Counts lines of the log, those that fell out too. */
  logged: number;
  /**
   * Site's time, ns, when the newest batch was sent; its speed; `performance.now()` when a batch sent then
   * comes that travels as fast as the fastest of the last seconds, so that `siteNow` runs evenly.
   */
  sentNs: number;
  speed: number;
  cameAt: number;
  /** Bytes and batches received in the last whole second, events lost since the page was opened. */
  traffic: { bytes: number; batches: number; dropped: number };
  /** Number of unreadable batches or messages and failed frames, and the last error. */
  faults: { count: number; last: string };
}

/** Lines that the log keeps. */
export const LOG_LINES = 400;

/** A site of which nothing is known yet. */
export function emptySite(): Site {
  return {
    hello: null,
    status: null,
    timeline: null,
    playing: null,
    connected: false,
    lostAt: 0,
    mapVersion: 0,
    map: null,
    people: new Map(),
    objects: new Map(),
    changes: new Map(),
    robots: new Map(),
    selection: null,
    manner: null,
    strips: null,
    lamps: new Map(),
    conveyor: null,
    health: new Map(),
    carriers: new Map(),
    deployments: new Map(),
    fresh: [],
    log: [],
    logged: 0,
    sentNs: 0,
    speed: 1,
    cameAt: 0,
    traffic: { bytes: 0, batches: 0, dropped: 0 },
    faults: { count: 0, last: "" },
  };
}

/** A person without any messages. */
export function emptyPerson(user: string): Person {
  return {
    user,
    profile: null,
    pose: null,
    cursor: null,
    cursorAt: 0,
    hover: null,
    announced: null,
    interaction: null,
    localization: null,
    understood: null,
    goal: null,
    proposed: null,
    steering: null,
    line: null,
  };
}

/** Tracked objects, without the robots, which are shown by their states. */
export function thingsOf(site: Site): { object: TrackedObject; stamp_ns: number }[] {
  return [...site.objects.values()].flatMap(({ objects, stamp_ns }) =>
    objects.filter(({ id }) => !site.robots.get(id)?.state).map((object) => ({ object, stamp_ns })),
  );
}

/** Owners of what is selected, by object; without what their carriers have not told yet. */
export function ownersOf({ selection }: Pick<Site, "selection">): Map<string, string> {
  const settled = selection?.objects.filter(({ is_pending }) => !is_pending) ?? [];
  return new Map(settled.map(({ id, user }) => [id, user]));
}

/** People who are about to select an object, by object: it is reserved, or its carriers have not told the result. */
export function holdersOf({ selection }: Pick<Site, "selection">): Map<string, string> {
  const pending = selection?.objects.filter(({ is_pending }) => is_pending) ?? [];
  return new Map([...(selection?.reserved ?? []), ...pending].map(({ id, user }) => [id, user]));
}

/** Whether the lamp is the light of a thing, whose name is shown instead. */
export function isOfThing(map: Environment | null, lamp: string): boolean {
  return map?.things.some((thing) => thing.lamp === lamp) ?? false;
}

/** A cursor that is older says nothing of now, ms: that wrist is not heard. */
const HEARD_MS = 800;

/** Whether the cursor of `person` is one of `now` (`performance.now()`). */
export function isHeard(person: Person, now: number): boolean {
  return person.cursor !== null && now - person.cursorAt < HEARD_MS;
}

/** Whether the last proposal of `person` was sent. */
export function isSent({ goal, proposed }: Person): boolean {
  return !!goal && !!proposed && goal.position_m.every((each, axis) => each === proposed[axis]);
}

/** Place that `person` is asked to confirm, or null; who steers robots has way-points instead. */
export function proposalOf(person: Person): [number, number, number] | null {
  return person.steering || isSent(person) ? null : person.proposed;
}

/** The last goal of `person`; of one who steers robots only while a robot carries it out. */
export function goalOf(site: Site, { goal, steering }: Person): Goal | null {
  const isOver =
    steering && ![...site.robots.values()].some(({ state }) => state?.goal_ns === goal?.stamp_ns);
  return isOver ? null : goal;
}

/** Where a person's feet are ({W}, m) and the azimuth of {H}'s x axis, rad. */
export interface Standing {
  position_m: [number, number, number];
  yaw_rad: number;
  /** There is no pose: this is where they are taken to stand. */
  isAssumed: boolean;
}

/** Pose of `person`, or null if unknown. */
export function standingOf({ pose, line }: Person): Standing | null {
  const known = pose ?? line?.assumed;
  return known ? { position_m: known.position_m, yaw_rad: known.yaw_rad, isAssumed: !pose } : null;
}

/** Now in the site's time, ns, as well as it is known. */
export function siteNow(site: Site): number {
  return site.sentNs + (performance.now() - site.cameAt) * 1e6 * site.speed;
}

/** Where the playback is, s from the beginning of the past; 0 of the present. */
export function position(site: Site): number {
  const { timeline } = site;
  return timeline ? Math.min(Math.max((siteNow(site) - timeline.began_ns) / 1e9, 0), timeline.length_s) : 0;
}

export type SiteEvent = { event: SelectionEvent } | { feedback: Feedback; user: string };
