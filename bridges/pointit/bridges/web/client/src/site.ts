/** What the page knows of the site: the newest message of every key, and what the server says of itself. */

import type {
  ConveyorState, Cursor, Deployment, Environment, Feedback, Health, Hover, Interaction, LampColor, Localization,
  Selection, SelectionEvent, StripsFrame, TrackedObjects, UserPose, UserProfile,
} from "./messages";
import type { Hello, PersonLine, Status } from "./wire";

/** All that is known of one person. */
export interface Person {
  readonly user: string;
  profile: UserProfile | null;
  pose: UserPose | null;
  cursor: Cursor | null;
  /** `performance.now()` when the newest cursor came; an old one is not drawn. */
  cursorAt: number;
  hover: Hover | null;
  interaction: Interaction | null;
  localization: Localization | null;
  /** What the server says: who moves the wrist. */
  line: PersonLine | null;
}

/** One line of the message log. */
export interface LogLine {
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
  /** Open, or since when (`performance.now()`) not. */
  connected: boolean;
  lostAt: number;
  /** Counts maps: a view builds its scene anew when it has changed. */
  mapVersion: number;
  map: Environment | null;
  /** Only people who are there now. */
  readonly people: Map<string, Person>;
  /** By tracker. */
  readonly objects: Map<string, TrackedObjects>;
  selection: Selection | null;
  strips: StripsFrame | null;
  /** By lamp id. */
  readonly lamps: Map<string, LampColor>;
  conveyor: ConveyorState | null;
  /** By instance. */
  readonly health: Map<string, Health>;
  /** By name: what was started. */
  readonly deployments: Map<string, Deployment>;
  /** Newest last, at most some hundreds. */
  readonly log: LogLine[];
  /** Site's time, ns, when the newest batch was sent; its speed; `performance.now()` when it came. */
  sentNs: number;
  speed: number;
  cameAt: number;
  /** From capture at the wrist to the frame that shows it, ms, of the last seconds; newest last. */
  readonly latencies: number[];
  /** Bytes and batches received in the last whole second, events lost. */
  traffic: { bytes: number; batches: number; dropped: number };
}

/** Now in the site's time, ns, as well as it is known. */
export function siteNow(site: Site): number {
  return site.sentNs + (performance.now() - site.cameAt) * 1e6 * site.speed;
}

export type Happened = { event: SelectionEvent } | { feedback: Feedback; user: string };
