/** Updates of the site's state by messages. */

import { decode } from "@msgpack/msgpack";
import type { Item } from "./batch";
import { Episodes, note, problemsOf } from "./log";
import type { Robot } from "./robots";
import { noteChange } from "./things";
import { emptyPerson, siteNow, type SiteEvent, type LogLine, type Person, type Site } from "./site";
import type { SelectionEvent } from "../messages";
import type { Topics } from "../topics";
import type { Status } from "../wire";
import { eventLine } from "../words";

/** Topics that pages are not shown; the others are `registry.SHOWN`. */
type Unseen =
  | "clock"
  | "leds/leases"
  | "users/{user}/imu"
  | "users/{user}/wrist"
  | "users/{user}/button"
  | "users/{user}/step"
  | "users/{user}/ray"
  | "users/{user}/anchor"
  | "users/{user}/claim"
  | "users/{user}/speech"
  | "acts/{carrier}"
  | "configuration/{service}"
  | "requests/{service}";
type Shown = Omit<Topics, Unseen>;

type Taker<M> = (keeper: Keeper, message: M, name: string, at: number) => void;

const TAKERS: { [K in keyof Shown]: Taker<Shown[K]> } = {
  "users/{user}/profile": (keeper, message, name) => void (keeper.person(name).profile = message),
  "users/{user}/pose": (keeper, message, name) => void (keeper.person(name).pose = message),
  "users/{user}/localization": (keeper, message, name) => void (keeper.person(name).localization = message),
  "users/{user}/cursor": (keeper, message, name, at) => {
    const who = keeper.person(name);
    who.cursor = message;
    // after a jump in the past, the newest may be old
    who.cursorAt = keeper.site.timeline
      ? at - Math.max(0, siteNow(keeper.site) - Number(message.stamp_ns)) / 1e6
      : at;
  },
  "users/{user}/hover": (keeper, message, name) => void (keeper.person(name).hover = message),
  "users/{user}/announced": (keeper, message, name) => void (keeper.person(name).announced = message),
  "users/{user}/interaction": (keeper, message, name) => {
    const who = keeper.person(name);
    const before = who.interaction?.state;
    who.interaction = message;
    if (before !== undefined && message.state !== before) {
      note(keeper.site, "info", name, message.reason ? `${message.state}: ${message.reason}` : message.state);
    }
  },
  "users/{user}/feedback": (keeper, message, name) => {
    const { site } = keeper;
    if (message.point_m) keeper.person(name).proposed = message.cue === "selected" ? message.point_m : null;
    keeper.tell("users/{user}/feedback", message, name);
    addSiteEvent(site, { feedback: message, user: name });
  },
  "users/{user}/understood": (keeper, message, name) => {
    keeper.person(name).understood = message;
    keeper.tell("users/{user}/understood", message, name);
  },
  "users/{user}/goal": (keeper, message, name) => void (keeper.person(name).goal = message),
  "users/{user}/steering": (keeper, message, name) => void (keeper.person(name).steering = message),
  "robots/{robot}/state": (keeper, message, name, at) => {
    const robot = keeper.robot(name);
    const before = robot.state;
    const { site } = keeper;
    robot.state = message;
    robot.heardAt = at;
    if (!before) return;
    if (message.user !== before.user)
      note(site, "info", name, message.user ? `${message.user} steers it` : "nobody steers it");
    if (message.reason && (!before.reason || message.phase !== before.phase))
      note(site, "warning", name, message.reason);
  },
  "robots/{robot}/plan": (keeper, message, name) => void (keeper.robot(name).plan = message),
  map: ({ site }, message) => {
    if (site.map && site.map.name !== message.name) {
      // another room: what was on the old one's belts is not in it; what is in it is told many times a second
      site.objects.clear();
      site.strips = null;
    }
    site.map = message;
    site.mapVersion += 1;
  },
  "objects/{tracker}": ({ site }, message, name) => void site.objects.set(name, message),
  selection: ({ site }, message) => void (site.selection = message),
  "selection/manner": ({ site }, message) => void (site.manner = message),
  "selection/events": (keeper, message) => keeper.onEvent(message), // of acts, the server sends them with their results
  "selection/outcomes": () => undefined,
  "things/{carrier}": ({ site }, message, name) => void site.carriers.set(name, message),
  "leds/{led}/color": ({ site }, message, name) => void site.lamps.set(name, message),
  "strips/frame": ({ site }, message) => void (site.strips = message),
  "conveyor/state": ({ site }, message) => void (site.conveyor = message),
  "health/{service}": ({ site, warned }, message, name, at) => {
    for (const problem of problemsOf(message))
      if (problem.severity === "warning" && warned.isNew(name, problem, at))
        note(site, "warning", name, problem.sentence);
    site.health.set(name, message);
  },
  "deployment/{name}": ({ site }, message, name) => void site.deployments.set(name, message),
};

type Told = "users/{user}/feedback" | "users/{user}/understood" | "selection/events";

/** Text of an event in the log, or null if it is not logged. */
const LINES: {
  [K in Told]: (
    site: Site,
    message: Topics[K],
    name: string,
  ) => Pick<LogLine, "severity" | "who" | "text"> | null;
} = {
  "users/{user}/feedback": (_site, message, name) =>
    message.text && (message.point_m || (message.cue !== "selected" && message.cue !== "deselected"))
      ? { severity: message.cue === "refused" ? "warning" : "info", who: name, text: message.text }
      : null,
  "users/{user}/understood": (_site, message, name) => ({
    severity: message.result === "refused" ? "warning" : "info",
    who: name,
    text: `“${message.text}”: ${message.message || message.result}`,
  }),
  "selection/events": (site, message) => ({ ...eventLine(site, message), who: message.user }),
};

type Forgetter = (keeper: Keeper, name: string) => void;

const FORGETTERS: Record<keyof Shown, Forgetter> = {
  "users/{user}/profile": (keeper, name) => void (keeper.person(name).profile = null),
  "users/{user}/pose": (keeper, name) => void (keeper.person(name).pose = null),
  "users/{user}/localization": (keeper, name) => void (keeper.person(name).localization = null),
  "users/{user}/cursor": (keeper, name) => void (keeper.person(name).cursor = null),
  "users/{user}/hover": (keeper, name) => void (keeper.person(name).hover = null),
  "users/{user}/announced": (keeper, name) => void (keeper.person(name).announced = null),
  "users/{user}/interaction": (keeper, name) => void (keeper.person(name).interaction = null),
  "users/{user}/feedback": () => undefined,
  "users/{user}/understood": () => undefined,
  "users/{user}/goal": () => undefined,
  "users/{user}/steering": (keeper, name) => void (keeper.person(name).steering = null),
  "robots/{robot}/state": ({ site }, name) => void site.robots.delete(name),
  "robots/{robot}/plan": (keeper, name) => {
    const robot = keeper.site.robots.get(name);
    if (robot) robot.plan = null;
  },
  map: ({ site }) => {
    site.map = null;
    site.mapVersion += 1;
  },
  "objects/{tracker}": ({ site }, name) => void site.objects.delete(name),
  selection: ({ site }) => void (site.selection = null),
  "selection/manner": ({ site }) => void (site.manner = null),
  "selection/events": () => undefined,
  "selection/outcomes": () => undefined,
  "things/{carrier}": ({ site }, name) => void site.carriers.delete(name),
  "leds/{led}/color": ({ site }, name) => void site.lamps.delete(name),
  "strips/frame": ({ site }) => void (site.strips = null),
  "conveyor/state": ({ site }) => void (site.conveyor = null),
  "health/{service}": ({ site }, name) => void site.health.delete(name),
  "deployment/{name}": ({ site }, name) => void site.deployments.delete(name),
};

/** Keeps a site up to date. */
export class Keeper {
  /** All people with messages; `site.people` has those who are present. */
  private readonly known = new Map<string, Person>();

  warned = new Episodes();
  /** Stamp of the newest event in the log, ns. */
  toldNs = 0;

  constructor(readonly site: Site) {}

  /**
   * Take one message over; `at` is `performance.now()`. Topics that this page does not know are passed over:
   * servers may be newer.
   * @returns the message, or null if there is none.
   * @throws Error when it cannot be read.
   */
  take(item: Item, at: number): unknown {
    const topic = item.topic as keyof Shown;
    if (!Object.hasOwn(TAKERS, topic)) return null;
    if (item.payload === null) {
      FORGETTERS[topic](this, item.name);
      return null;
    }
    const message = decode(item.payload);
    if (message === null || typeof message !== "object") throw new Error(`${topic}: no message`);
    (TAKERS[topic] as Taker<unknown>)(this, message, item.name, at);
    return message;
  }

  /** Tell what happened to an object: on its tile, in the log, to who did it. */
  onEvent(event: SelectionEvent): void {
    noteChange(this.site, event);
    this.tell("selection/events", event, "");
    addSiteEvent(this.site, { event });
  }

  /** Write an event into the log; `at`: when it happened, Unix time, ms. */
  tell<K extends Told>(topic: K, message: Topics[K], name: string, at?: number): void {
    this.toldNs = Math.max(this.toldNs, Number(message.stamp_ns));
    const line = LINES[topic](this.site, message, name);
    if (line) note(this.site, line.severity, line.who, line.text, at);
  }

  /**
   * Write into the log what happened before this page came, unless it was there already before it lost the connection:
   * what is not newer than `knownNs`.
   * @throws Error when it cannot be read.
   */
  recall(item: Item, knownNs: number): void {
    if (item.payload === null || !Object.hasOwn(LINES, item.topic)) return;
    const message = decode(item.payload) as Topics[Told];
    const stamp = Number(message.stamp_ns);
    const { site } = this;
    if ("object_id" in message) noteChange(site, message);
    if (stamp <= knownNs) return;
    const ago = (siteNow(site) - stamp) / 1e6 / site.speed;
    this.tell(item.topic as Told, message as never, item.name, Date.now() - ago);
  }

  /** Apply the server's status: people who have left are removed with their states. */
  status(status: Status): void {
    const { site } = this;
    const before = site.status;
    site.status = status;
    const there = new Set(status.people.map((line) => line.user));
    for (const user of site.people.keys()) {
      if (there.has(user)) continue;
      site.people.delete(user);
      note(site, "info", user, "left");
    }
    for (const line of status.people) {
      if (before && !site.people.has(line.user)) note(site, "info", line.user, "came");
      const who = this.person(line.user);
      who.line = line;
      site.people.set(line.user, who);
    }
    const were = new Map(before?.services.map((service) => [service.instance, service.present]));
    for (const { instance, present } of status.services) {
      const was = were.get(instance);
      if (was !== undefined && was !== present) {
        note(site, present ? "info" : "warning", instance, present ? "is up again" : "is down");
      }
    }
  }

  /** Clear the state: the first batch of a new connection has everything that is valid. */
  clear(): void {
    const { site } = this;
    this.known.clear();
    for (const all of [
      site.people,
      site.objects,
      site.changes,
      site.robots,
      site.lamps,
      site.health,
      site.carriers,
      site.deployments,
    ])
      all.clear();
    Object.assign(site, { status: null, selection: null, strips: null, conveyor: null });
  }

  /** The past was set to another time: forget what was told of before. */
  jumped(): void {
    this.warned = new Episodes();
    this.toldNs = 0;
    this.site.changes.clear();
    this.site.log.length = 0;
    this.site.logged += 1; // the log shows that it has changed
    this.site.fresh.length = 0;
  }

  /** Time stood still until `at`, since `before` (`performance.now()`): cursors and robots do not age. */
  hold(before: number, at: number): void {
    for (const person of this.known.values()) person.cursorAt += at - before;
    for (const robot of this.site.robots.values()) robot.heardAt += at - before;
  }

  /** The robot called `name`, new if not known yet. */
  robot(name: string): Robot {
    const found = this.site.robots.get(name) ?? { name, state: null, plan: null, heardAt: 0 };
    this.site.robots.set(name, found);
    return found;
  }

  /** The person called `user`, new if not known yet. */
  person(user: string): Person {
    let found = this.known.get(user);
    if (!found) {
      found = emptyPerson(user);
      this.known.set(user, found);
    }
    return found;
  }
}

/** More are dropped between two frames: a page in the background is shown none. */
const MOST_FRESH = 200;

function addSiteEvent(site: Site, what: SiteEvent): void {
  site.fresh.push(what);
  if (site.fresh.length > MOST_FRESH) site.fresh.shift();
}
