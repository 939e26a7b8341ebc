// What travels between server and page, from wire.json. Written by `npm run types`; do not edit.

export interface Everything {
  Ack: Ack;
  AimAt: AimAt;
  Answer: Answer;
  Ask: Ask;
  AssumedPlace: AssumedPlace;
  Cue: Cue;
  FindingLine: FindingLine;
  Hello: Hello;
  PersonLine: PersonLine;
  ServiceLine: ServiceLine;
  Status: Status;
  Turn: Turn;
}
/**
 * A batch was shown.
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
 * The mouse points at a place, {W}.
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
 * What came of an `Ask`.
 */
export interface Answer {
  /**
   * one sentence, why not; empty: it was done
   */
  error: string;
  id: number;
  kind: "answer";
  /**
   * fields of the reply; empty: refused
   */
  reply: {
    [k: string]: unknown;
  } | null;
}
/**
 * A wish: a request of the table by its key pattern, or a deed of the server's own.
 */
export interface Ask {
  deed: ("press" | "take" | "give" | "tremor" | "pair" | "open_lan" | "centre") | null;
  id: number;
  /**
   * of the table of requests; empty: a deed is asked
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
 * Where a person is taken to stand.
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
 * What a phone tells its person: a `Feedback` of the bus, or the state of the interaction.
 */
export interface Cue {
  chime: string;
  haptic_ms: number[];
  /**
   * the arm does not follow this phone any more
   */
  has_lost_arm: boolean;
  kind: "cue";
  next_step: string;
  /**
   * of pointing at targets; empty: nothing is to be pointed at
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
 * One thing that is wrong, and what to do.
 */
export interface FindingLine {
  remedy: string;
  sentence: string;
  service: string;
  severity: "error" | "warning" | "note";
}
/**
 * Who the page is to this server.
 */
export interface Hello {
  deeds: ("press" | "take" | "give" | "tremor" | "pair" | "open_lan" | "centre")[];
  kind: "hello";
  /**
   * keys of the requests this page may ask
   */
  requests: string[];
  role: "operator" | "viewer" | "wrist";
  site: string;
  /**
   * of a phone: whose wrist it is
   */
  user: string;
  /**
   * of PointIt
   */
  version: string;
}
/**
 * A person who is there.
 */
export interface PersonLine {
  /**
   * as long as they have no pose; empty: nobody says where
   */
  assumed: AssumedPlace | null;
  battery: number | null;
  /**
   * by this very page
   */
  is_mine: boolean;
  moved_by: "own" | "mouse" | "phone";
  /**
   * what a paired phone says of itself; empty: none is paired
   */
  phone: string;
  user: string;
}
/**
 * A service that is there, was there, or should be.
 */
export interface ServiceLine {
  instance: string;
  present: boolean;
  /**
   * up, or down, for so long, wall seconds
   */
  since_s: number;
}
/**
 * How the site is; what topics do not say.
 */
export interface Status {
  findings: FindingLine[];
  kind: "status";
  /**
   * where the local network finds the page; empty: closed
   */
  lan_url: string;
  people: PersonLine[];
  services: ServiceLine[];
  viewers: number;
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
