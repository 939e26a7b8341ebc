/** The binary half of the wire: batches, see the docstring of `wire.py`. */

import { decode } from "@msgpack/msgpack";

/** One message as on the bus: the key's pattern, the name for its placeholder, msgpack. */
export interface Item {
  topic: string;
  name: string;
  /** Null: the key's message is no longer valid. */
  payload: Uint8Array | null;
}

export interface Batch {
  n: number;
  /** The site's time when it was sent, ns. */
  sentNs: number;
  speed: number;
  /** The newest of each key. */
  states: Item[];
  /** Every one, in order. */
  events: Item[];
  /** Events that this page has missed since the batch before because it was too slow. */
  dropped: number;
}

/**
 * Return the batch in `bytes`; payloads stay encoded.
 * @throws Error in one sentence, when it is none.
 */
export function decodeBatch(bytes: Uint8Array): Batch {
  const parts = decode(bytes);
  if (!Array.isArray(parts) || parts.length < 6) throw new Error("a batch has six parts");
  const [n, sentNs, speed, states, events, dropped] = parts as unknown[];
  return {
    n: finite(n, "n"),
    sentNs: finite(sentNs, "sent_ns"),
    speed: finite(speed, "speed"),
    states: items(states, "states"),
    events: items(events, "events"),
    dropped: finite(dropped, "dropped"),
  };
}

/** Return the number of a batch that cannot be read otherwise, so that it can be acknowledged; 0: unknown. */
export function numberOf(bytes: Uint8Array): number {
  try {
    const parts = decode(bytes);
    return Array.isArray(parts) && Number.isSafeInteger(parts[0]) ? (parts[0] as number) : 0;
  } catch {
    return 0;
  }
}

/** What came since the frame before: of each key the newest state, every event. */
export class Pending {
  private readonly states = new Map<string, Item>();
  private readonly events: Item[] = [];
  /** Events from before the page came: those of its first batch. */
  private readonly history: Item[] = [];

  add(batch: Batch): void {
    for (const item of batch.states) this.states.set(`${item.topic} ${item.name}`, item);
    (batch.n === 1 ? this.history : this.events).push(...batch.events);
  }

  /** Drop events, not states: the server sends no state twice. */
  forgetEvents(): void {
    this.events.length = this.history.length = 0;
  }

  /** Return all, and hold nothing more. */
  take(): { states: Item[]; events: Item[]; history: Item[] } {
    const taken = {
      states: [...this.states.values()],
      events: this.events.splice(0),
      history: this.history.splice(0),
    };
    this.states.clear();
    return taken;
  }
}

function finite(value: unknown, what: string): number {
  const number = typeof value === "bigint" ? Number(value) : value;
  if (typeof number !== "number" || !Number.isFinite(number))
    throw new Error(`${what} of a batch is no number`);
  return number;
}

function items(value: unknown, what: string): Item[] {
  if (!Array.isArray(value)) throw new Error(`${what} of a batch is no list`);
  return value.map((each: unknown) => {
    if (!Array.isArray(each)) throw new Error(`${what} of a batch has a malformed message`);
    const [topic, name, payload] = each as unknown[];
    if (
      typeof topic !== "string" ||
      typeof name !== "string" ||
      !(payload === null || payload instanceof Uint8Array)
    ) {
      throw new Error(`${what} of a batch has a malformed message`);
    }
    return { topic, name, payload };
  });
}
