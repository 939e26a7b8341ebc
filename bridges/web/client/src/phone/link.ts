/** The way to the server: its socket, or posts where the browser refuses that; found again when it is lost. */

import type { Answer, Ask, Cue, Hello, Turn } from "../wire";
import { RetryPolicy, type Transport } from "./retry_policy";

export type Heard = Hello | Answer | Cue;
export type LinkState = "connecting" | "open" | "unpaired" | "replaced" | "closed";

export interface LinkEvents {
  heard(part: Heard): void;
  changed(state: LinkState): void;
}

/** Silence after which the connection counts as dead, even if the browser reports it open, ms. */
const SILENT_MS = 6000;
/** How often, ms, a round trip is measured. */
const ECHO_MS = 2000;
/** Close codes, see `wire.py`. */
const UNPAIRED = 4403;
const REPLACED = 4409;

type Wish = Omit<Ask, "kind" | "id">;

export class Link {
  state: LinkState = "closed";
  transport: Transport = "socket";
  /** The last round trip, ms; null: none yet. */
  roundTrip: number | null = null;
  private readonly retries = new RetryPolicy();
  private socket: WebSocket | null = null;
  private turn: Turn | null = null;
  private asks: Ask[] = [];
  private posting: AbortController | null = null;
  private number = 0;
  private echo = { id: -1, at: 0 };
  private heardAt = 0;
  private again: ReturnType<typeof setTimeout> | undefined;
  private watch: ReturnType<typeof setInterval> | undefined;

  constructor(private readonly events: LinkEvents) {}

  /** Connect, and stay so. */
  start(): void {
    this.stop();
    this.watch = setInterval(() => this.look(), 500);
    this.attempt();
  }

  /** Let go. */
  stop(): void {
    clearTimeout(this.again);
    clearInterval(this.watch);
    this.drop();
    this.become("closed");
  }

  /** Bytes that are on their way. */
  get buffered(): number {
    return this.transport === "post" ? (this.posting ? Infinity : 0) : (this.socket?.bufferedAmount ?? 0);
  }

  /** Say how the phone is turned; returns whether it could be said. */
  say(turn: Turn): boolean {
    if (this.state !== "open") return false;
    if (this.transport === "post") {
      this.turn = turn;
      void this.post();
    } else {
      this.socket?.send(JSON.stringify(turn));
    }
    return true;
  }

  /** Send a request; returns its id, or null if there is no connection. */
  ask(wish: Wish): number | null {
    if (this.state !== "open") return null;
    const ask: Ask = { kind: "ask", id: ++this.number, ...wish };
    if (this.transport === "post") {
      this.asks.push(ask);
      void this.post();
    } else {
      this.socket?.send(JSON.stringify(ask));
    }
    return ask.id;
  }

  private attempt(): void {
    this.become("connecting");
    this.transport = this.retries.nextTransport();
    this.heardAt = performance.now();
    if (this.transport === "post") void this.post(true);
    else this.open();
  }

  private open(): void {
    const url = new URL("/ws/wrist", location.href);
    url.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(url);
    this.socket = socket;
    let wasOpen = false;
    socket.onopen = () => {
      wasOpen = true;
      this.opened();
    };
    socket.onmessage = ({ data }) => this.hear(String(data));
    socket.onclose = ({ code }) => {
      if (this.socket !== socket) return;
      this.socket = null;
      if (code === UNPAIRED || code === REPLACED) this.end(code === UNPAIRED ? "unpaired" : "replaced");
      else this.lost(wasOpen);
    };
  }

  /** Post queued messages; one post at a time, the newest turn only. */
  private async post(isGreeting = false): Promise<void> {
    if (this.posting) return;
    const stop = (this.posting = new AbortController());
    const items = isGreeting ? [] : [...this.asks, ...(this.turn ? [this.turn] : [])];
    this.asks = [];
    this.turn = null;
    const began = performance.now();
    const patience = setTimeout(() => stop.abort(), SILENT_MS);
    let answer: Response | null = null;
    let parts: unknown = null;
    try {
      answer = await fetch("/wrist", {
        method: "POST",
        body: JSON.stringify(items),
        headers: { "Content-Type": "application/json" },
        signal: stop.signal,
      });
      if (answer.ok) parts = await answer.json();
    } catch {
      // The server is not there, or not in time; told below.
    }
    clearTimeout(patience);
    if (this.posting !== stop) return;
    this.posting = null;
    if (answer?.status === 403) return this.end("unpaired");
    if (!Array.isArray(parts)) return this.lost(this.state === "open");
    if (items.every(({ kind }) => kind === "turn")) this.roundTrip = performance.now() - began;
    if (isGreeting) this.opened();
    for (const part of parts) this.take(part);
    if (this.asks.length) void this.post();
  }

  private opened(): void {
    this.retries.noteSuccess();
    this.heardAt = performance.now();
    this.become("open");
    if (this.transport === "socket") this.measure();
  }

  private hear(text: string): void {
    try {
      this.take(JSON.parse(text));
    } catch {
      // Not of this server's words; a newer one may say more than is known here.
    }
  }

  private take(part: unknown): void {
    const heard = part as Heard;
    this.heardAt = performance.now();
    if (heard.kind === "answer" && heard.id === this.echo.id) this.roundTrip = this.heardAt - this.echo.at;
    else if (["hello", "answer", "cue"].includes(heard.kind)) this.events.heard(heard);
  }

  /** Ask for nothing: the answer, that there is no such thing, is the echo. */
  private measure(): void {
    this.echo.at = performance.now();
    this.echo.id = this.ask({ deed: null, key: "", name: "", query: {} }) ?? -1;
  }

  private look(): void {
    if (this.state !== "open" || this.transport !== "socket") return;
    const now = performance.now();
    if (now - this.heardAt > SILENT_MS) {
      this.drop();
      this.lost(true);
    } else if (now - this.echo.at > ECHO_MS) {
      this.measure();
    }
  }

  private lost(wasOpen: boolean): void {
    this.roundTrip = null;
    const wait = this.retries.noteFailure(wasOpen);
    this.become("connecting");
    clearTimeout(this.again);
    this.again = setTimeout(() => this.attempt(), wait);
  }

  private end(state: LinkState): void {
    clearTimeout(this.again);
    clearInterval(this.watch);
    this.become(state);
  }

  private drop(): void {
    const socket = this.socket;
    this.socket = null;
    socket?.close();
    this.posting?.abort();
    this.posting = null;
    this.asks = [];
    this.turn = null;
  }

  private become(state: LinkState): void {
    if (state === this.state) return;
    this.state = state;
    this.events.changed(state);
  }
}
