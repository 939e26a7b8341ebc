/** The page's end of the WebSocket: batches into the site, acknowledgements out of animation frames. */

import { Keeper } from "./apply";
import { Asks, type Reply, type Wish } from "./asks";
import { decodeBatch, numberOf, Pending } from "./batch";
import { note } from "./log";
import type { Vec3 } from "../geometry/vec";
import type { Cursor, StripsFrame } from "../messages";
import type { Site } from "./site";

/** Where pages find the present, and the last minutes of a running site. */
const PRESENT = "/ws";
const PAST = "/ws/past";
import { LatencyHistory, SiteClock } from "./timing";
import type { Ack, AimAt, Answer, Ask, Hello, Play, Playing, Status, Timeline, HeadsetMotion } from "../wire";

/** Waiting times between attempts to connect, ms; a little is added at random, so that pages do not storm. */
const BACK_OFF_MS = [250, 500, 1000, 2000, 4000, 8000];

/** Maximum number of unsent bytes at which an aim is sent: late ones are useless. */
const MOST_BUFFERED = 16_384;

/** What the connection needs of a WebSocket. */
export type Socket = Pick<
  WebSocket,
  "readyState" | "bufferedAmount" | "binaryType" | "onopen" | "onmessage" | "onclose" | "send" | "close"
>;

/** Open a WebSocket of the server that the page is from. */
export function toServer(path: string): Socket {
  return new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}${path}`);
}

export interface ConnectionEvents {
  /** Something came that a frame should show. */
  onUpdate(): void;
  onHello(hello: Hello): void;
  /** The status has come, or what is known of the past that is played. */
  onStatus(): void;
  /** Opened, or lost (`attempt` counts from 1). */
  onState(connected: boolean, attempt: number): void;
}

export class Connection {
  readonly latency = new LatencyHistory();
  private readonly asks = new Asks((ask) => this.send(ask));
  private readonly pending = new Pending();
  private readonly keeper: Keeper;
  private clock = new SiteClock();
  /** The server is there and does not let this page in: it is not the one that the page was opened by. */
  isRefused = false;
  /** Why the server that this page is from gives it no websocket, in its own words; "" if that is not known. */
  reason = "";
  private socket: Socket | null = null;
  private path = PRESENT;
  private attempt = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;
  /** Batches that wait for their frame: number and when they came. */
  private unacknowledged: { n: number; at: number }[] = [];
  private second = { bytes: 0, batches: 0 };
  private dropped = 0;
  /** What the last frame was made of, for its latency: capture, ns, of what is newest in it. */
  private capturedNs = 0;
  private lastAimed = 0;
  private lastFrame = 0;
  /** The next frame tells no latency: what it shows waited for a page in the background, or was told anew. */
  private isCatchingUp = true;

  /** @param connect opens the other end at a path. */
  constructor(
    private readonly site: Site,
    private readonly connect: (path: string) => Socket,
    private readonly events: ConnectionEvents,
  ) {
    this.keeper = new Keeper(site);
    setInterval(() => {
      site.traffic = { ...this.second, dropped: this.dropped };
      this.second = { bytes: 0, batches: 0 };
    }, 1000);
    addEventListener("online", () => this.hurry());
    document.addEventListener("visibilitychange", () => {
      this.isCatchingUp = true;
      if (!document.hidden) this.hurry();
    });
  }

  /** Begin to connect, and keep at it for ever. */
  open(): void {
    const socket = this.connect(this.path);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => this.opened();
    socket.onmessage = (event: MessageEvent<string | ArrayBuffer>) => this.received(event.data);
    socket.onclose = () => this.closed(socket);
  }

  /** Show the last minutes of the running site, or again what happens now. */
  visit(isPast: boolean): void {
    const { socket } = this;
    this.path = isPast ? PAST : PRESENT;
    this.socket = null;
    socket?.close();
    clearTimeout(this.timer);
    this.drop();
    this.open();
  }

  /** Control the playback; not answered. */
  play(wish: Partial<Omit<Play, "kind">>): void {
    this.send({ kind: "play", ...wish });
  }

  ask(wish: Wish, patienceMs?: number): Promise<Reply> {
    return this.asks.ask(wish, patienceMs);
  }

  /** Tell where the mouse points, at most as often as the screen shows; not answered. */
  aim(user: string, at: Vec3): void {
    const now = performance.now();
    if (now - this.lastAimed < 4 || (this.socket?.bufferedAmount ?? 0) > MOST_BUFFERED) return;
    this.lastAimed = now;
    this.send({ kind: "aim", user, at_m: at } satisfies AimAt);
  }

  /** Tell where the wearer of a headset points; not answered. */
  moveByHeadset(motion: HeadsetMotion): void {
    if ((this.socket?.bufferedAmount ?? 0) <= MOST_BUFFERED) this.send(motion);
  }

  /** Apply batches since the frame before; called at the start of an animation frame. */
  takeOver(): void {
    const { states, events, history } = this.pending.take();
    const at = performance.now();
    if (!this.site.speed) this.keeper.hold(this.lastFrame, at);
    this.lastFrame = at;
    const knownNs = this.keeper.toldNs; // of before: several things happen at one time
    for (const item of history) {
      try {
        this.keeper.recall(item, knownNs);
      } catch (error) {
        this.fault(error);
      }
    }
    let stripsNs = 0;
    let cursorNs = 0;
    for (const item of [...states, ...events]) {
      try {
        const message = this.keeper.take(item, at);
        if (message === null) continue;
        if (item.topic === "strips/frame") stripsNs = (message as StripsFrame).stamp_ns;
        else if (item.topic === "users/{user}/cursor")
          cursorNs = Math.max(cursorNs, (message as Cursor).stamp_ns);
      } catch (error) {
        this.fault(error);
      }
    }
    this.capturedNs = stripsNs || cursorNs;
  }

  /** Acknowledge the batches that this frame shows; called at its end. */
  shown(): void {
    if (!this.unacknowledged.length) return;
    const now = performance.now();
    const { site } = this;
    let latency: number | null = null;
    if (this.capturedNs && !this.isCatchingUp && !site.timeline) {
      const shownNs = site.sentNs + (now - site.cameAt) * 1e6 * site.speed;
      latency = Math.max(0, (shownNs - this.capturedNs) / 1e6 / site.speed);
      this.latency.add(now, latency);
    }
    this.isCatchingUp = document.hidden;
    for (const { n } of this.unacknowledged.splice(0)) {
      this.send({
        kind: "ack",
        n,
        latency_ms: latency === null ? null : Math.min(1e7, latency),
      } satisfies Ack);
    }
  }

  /** Count an error of reading or drawing. */
  fault(error: unknown): void {
    const { faults } = this.site;
    const text = error instanceof Error ? error.message : String(error);
    if (text !== faults.last) note(this.site, "error", "page", text);
    faults.count += 1;
    faults.last = text;
  }

  private opened(): void {
    if (this.site.lostAt) note(this.site, "info", "page", "connected again");
    this.attempt = 0;
    this.isRefused = false;
    this.reason = "";
    this.clock = new SiteClock();
    this.keeper.clear();
    this.site.timeline = this.site.playing = null;
    this.isCatchingUp = true;
    this.site.connected = true;
    this.events.onState(true, 0);
  }

  private closed(socket: Socket): void {
    if (socket !== this.socket) return;
    this.socket = null;
    this.path = PRESENT;
    this.drop();
    if (this.site.connected) {
      this.site.lostAt = performance.now();
      note(this.site, "warning", "page", "the connection was lost");
    } else void this.findOut();
    this.site.connected = false;
    const wait = BACK_OFF_MS[Math.min(this.attempt, BACK_OFF_MS.length - 1)]!;
    this.attempt += 1;
    this.events.onState(false, this.attempt);
    this.timer = setTimeout(() => this.open(), wait * (1 + 0.3 * Math.random()));
  }

  /** Forget what a socket was about to do. */
  private drop(): void {
    this.asks.lost();
    this.pending.take();
    this.unacknowledged = [];
  }

  /** Find out why the connection failed: a refused WebSocket has no reason. */
  private async findOut(): Promise<void> {
    const asked = `${PRESENT}?page=${encodeURIComponent(location.origin)}`;
    const answer = await fetch(asked, { cache: "no-store" }).catch(() => null);
    const isRefused = answer?.status === 403;
    // of a server that answers the question; a proxy has pages of its own
    const isTold = answer?.ok === true && (answer.headers.get("content-type") ?? "").startsWith("text/plain");
    const reason = isTold ? await answer.text() : "";
    if (this.site.connected || (this.isRefused === isRefused && this.reason === reason)) return;
    this.isRefused = isRefused;
    this.reason = reason;
    this.events.onState(false, this.attempt);
  }

  /** Try at once, where it would be tried later: the network or the person is back. */
  hurry(): void {
    if (this.socket) return;
    clearTimeout(this.timer);
    this.open();
  }

  private received(data: string | ArrayBuffer): void {
    try {
      if (typeof data === "string")
        this.text(JSON.parse(data) as Hello | Status | Answer | Timeline | Playing);
      else this.batch(new Uint8Array(data));
    } catch (error) {
      this.fault(error);
    }
  }

  private text(part: Hello | Status | Answer | Timeline | Playing): void {
    if (part.kind === "answer") this.asks.answered(part);
    else if (part.kind === "status") {
      this.keeper.status(part);
      this.events.onStatus();
    } else if (part.kind === "hello") {
      this.site.hello = part;
      this.events.onHello(part);
    } else if (part.kind === "timeline") {
      this.site.timeline = part;
      this.events.onStatus();
    } else if (part.kind === "playing") this.onPlaying(part);
  }

  private onPlaying(part: Playing): void {
    const { site } = this;
    site.playing = part;
    site.sentNs = (site.timeline?.began_ns ?? 0) + part.at_s * 1e9;
    site.cameAt = performance.now();
    site.speed = part.is_playing ? part.speed : 0;
    this.clock = new SiteClock();
    if (part.has_jumped) {
      this.pending.forgetEvents();
      this.keeper.jumped();
    }
    this.events.onStatus();
  }

  private batch(bytes: Uint8Array): void {
    const at = performance.now();
    this.second.bytes += bytes.byteLength;
    this.second.batches += 1;
    try {
      const batch = decodeBatch(bytes);
      this.site.cameAt = this.clock.heard(batch.sentNs, batch.speed, at);
      this.site.sentNs = batch.sentNs;
      this.site.speed = batch.speed;
      this.dropped += batch.dropped;
      this.pending.add(batch);
      this.unacknowledged.push({ n: batch.n, at });
    } catch (error) {
      // an unacknowledged batch would count as one on its way for ever
      const n = numberOf(bytes);
      if (n) this.send({ kind: "ack", n, latency_ms: null } satisfies Ack);
      this.fault(error);
    }
    this.events.onUpdate();
  }

  private send(part: Ack | Ask | AimAt | HeadsetMotion | (Partial<Play> & { kind: "play" })): boolean {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(part));
    return true;
  }
}
