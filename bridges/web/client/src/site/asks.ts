/** Requests to the server as promises. */

import type { RequestKey } from "../topics";
import type { Answer, Ask } from "../wire";

/** What was refused, in one sentence for a person. */
export class Refusal extends Error {
  /** @param isStale The page knows an older state of what it asked about: it has to read it again. */
  constructor(
    sentence: string,
    readonly isStale = false,
  ) {
    super(sentence);
  }
}

/** Reply fields of a request. */
export type Reply = Record<string, unknown>;

/** A request of the table, or a deed of the server's own; `name`: the person, where it is about one. */
export type Wish = ({ key: RequestKey } | { deed: NonNullable<Ask["deed"]> }) & {
  name?: string;
  query?: Record<string, unknown>;
};

/** Timeout of an answer, ms; `run/scenario` takes longer. */
export const PATIENCE_MS = 5_000;

interface Waiting {
  resolve(reply: Reply): void;
  reject(error: Refusal): void;
  timer: ReturnType<typeof setTimeout>;
}

/** Numbers requests, sends them, and matches the answers. */
export class Asks {
  private next = 1;
  private readonly waiting = new Map<number, Waiting>();

  /** @param send sends one request; returns false if it could not. */
  constructor(private readonly send: (ask: Ask) => boolean) {}

  /** Ask, and return the fields of the reply; rejects with a `Refusal`. */
  ask(wish: Wish, patienceMs = PATIENCE_MS): Promise<Reply> {
    const id = this.next++;
    const ask: Ask = {
      kind: "ask",
      id,
      key: "key" in wish ? wish.key : "",
      deed: "deed" in wish ? wish.deed : null,
      name: wish.name ?? "",
      query: wish.query ?? {},
    };
    return new Promise((resolve, reject) => {
      const timer = setTimeout(
        () => this.end(id)?.reject(new Refusal("Nobody answered in time; try again.")),
        patienceMs,
      );
      this.waiting.set(id, { resolve, reject, timer });
      if (!this.send(ask)) this.end(id)?.reject(new Refusal("There is no connection right now."));
    });
  }

  answered(answer: Answer): void {
    const waiting = this.end(answer.id);
    if (!waiting) return;
    if (answer.error) waiting.reject(new Refusal(answer.error, answer.is_stale));
    else waiting.resolve(answer.reply ?? {});
  }

  /** The connection is lost: nothing that was asked will be answered. */
  lost(): void {
    for (const id of [...this.waiting.keys()]) this.end(id)?.reject(new Refusal("The connection was lost."));
  }

  private end(id: number): Waiting | undefined {
    const waiting = this.waiting.get(id);
    if (waiting) clearTimeout(waiting.timer);
    this.waiting.delete(id);
    return waiting;
  }
}
