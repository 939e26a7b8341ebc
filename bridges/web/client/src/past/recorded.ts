/** The other end of the connection of a page that has its recording within itself: speaks as the server of a playback does. */

import { decodeMulti, encode } from "@msgpack/msgpack";
import type { Socket } from "../site/connection";
import type { Play, Playing } from "../wire";

/** Topic, name, payload; null: no longer valid. */
type News = [topic: string, name: string, payload: Uint8Array | null];
/** As `page_file.py` writes it. */
export type Frame = [atS: number, states: News[], events: News[], status: string];

/** Played between two animation frames at most, s: a page in the background waits. */
const MOST_S = 1;

/** Return the parts of the recording in the page. */
export async function unpacked(
  base64: string,
): Promise<[hello: string, timeline: string, ...frames: Frame[]]> {
  const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return [...decodeMulti(await new Response(stream).arrayBuffer())] as [string, string, ...Frame[]];
}

export class RecordedSocket implements Socket {
  readonly readyState = 1; // open
  readonly bufferedAmount = 0;
  binaryType: BinaryType = "arraybuffer";
  onopen: Socket["onopen"] = null;
  onmessage: Socket["onmessage"] = null;
  onclose: Socket["onclose"] = null;
  private readonly began: number;
  private readonly end: number;
  /** What the page has, by topic and name. */
  private held = new Map<string, News>();
  /** Frames that have been shown. */
  private count = 0;
  private batches = 0;
  private at = 0;
  private speed = 1;

  /** @param isPlaying from `start` on, s from the beginning. */
  constructor(
    private readonly hello: string,
    private readonly timeline: string,
    private readonly frames: readonly Frame[],
    private isPlaying: boolean,
    private readonly start = 0,
  ) {
    this.began = (JSON.parse(timeline) as { began_ns: number }).began_ns;
    this.end = frames.at(-1)?.[0] ?? 0;
  }

  /** Begin; the handlers are set. */
  open(): void {
    this.onopen?.call(this as never, new Event("open"));
    this.hear(this.hello);
    this.hear(this.timeline);
    this.jump(this.start);
  }

  close(): void {}

  /** Obey a `Play`. There is nothing else to do: the page may make no request. */
  send(text: string): void {
    const wish = JSON.parse(text) as Partial<Play>;
    if (wish.kind !== "play") return;
    this.speed = wish.speed ?? this.speed;
    this.isPlaying = wish.step ? false : (wish.is_playing ?? this.isPlaying);
    const to = wish.step ? this.frames[this.count - 1 + wish.step]?.[0] : wish.at_s;
    if (typeof to === "number") this.jump(to);
    else this.tell(false);
  }

  /** Play on by so many seconds of the wall clock. */
  advance(seconds: number): void {
    if (!this.isPlaying) return;
    this.at = Math.min(this.at + Math.min(seconds, MOST_S) * this.speed, this.end);
    if (seconds > MOST_S) this.tell(false); // else the page would take what comes for late
    for (let frame = this.next; frame; frame = this.next) {
      this.count += 1;
      for (const news of frame[1]) hold(this.held, news);
      this.show(...frame);
    }
    if (this.at < this.end) return;
    this.isPlaying = false;
    this.tell(false);
  }

  /** The frame that is due, if there is one. */
  private get next(): Frame | undefined {
    const frame = this.frames[this.count];
    return frame && frame[0] <= this.at ? frame : undefined;
  }

  /** Go there: the page gets the differences of states, and no event from between. */
  private jump(at: number): void {
    this.at = Math.min(Math.max(at, 0), this.end);
    this.count = 0;
    const held = new Map<string, News>();
    let status = "";
    for (let frame = this.next; frame; frame = this.next) {
      this.count += 1;
      for (const news of frame[1]) hold(held, news);
      status = frame[3] || status;
    }
    const news = [...held].filter(([key, each]) => this.held.get(key) !== each).map(([, each]) => each);
    for (const [key, [topic, name]] of this.held) if (!held.has(key)) news.push([topic, name, null]);
    this.held = held;
    this.tell(true);
    this.show(this.at, news, [], status);
  }

  private show(at: number, states: News[], events: News[], status: string): void {
    if (status) this.hear(status);
    this.batches += 1;
    this.hear(
      encode([
        this.batches,
        this.began + at * 1e9,
        this.isPlaying ? this.speed : 0,
        states,
        events,
        0,
      ]).slice().buffer,
    );
  }

  private tell(hasJumped: boolean): void {
    const playing: Playing = {
      kind: "playing",
      at_s: this.at,
      is_playing: this.isPlaying,
      speed: this.speed,
      has_jumped: hasJumped,
    };
    this.hear(JSON.stringify(playing));
  }

  private hear(data: string | ArrayBuffer): void {
    this.onmessage?.call(this as never, new MessageEvent("message", { data }));
  }
}

function hold(held: Map<string, News>, news: News): void {
  const key = `${news[0]} ${news[1]}`;
  if (news[2]) held.set(key, news);
  else held.delete(key);
}

/** Return the end of the connection that plays what is in `element`; it runs with the animation frames. */
export async function play(element: Element): Promise<() => RecordedSocket> {
  const start = Number(element.getAttribute("data-start-s"));
  const [hello, timeline, ...frames] = await unpacked(element.textContent);
  element.remove();
  return () => {
    const socket = new RecordedSocket(
      hello,
      timeline,
      frames,
      !matchMedia("(prefers-reduced-motion: reduce)").matches,
      start,
    );
    let before = 0;
    requestAnimationFrame(function begin(now: number): void {
      if (before) socket.advance((now - before) / 1000);
      else socket.open();
      before = now;
      requestAnimationFrame(begin);
    });
    return socket;
  };
}
