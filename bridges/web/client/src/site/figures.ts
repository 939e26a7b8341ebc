/** Figures of the whole site out of each service's own account. */

import type { Health } from "../messages";
import type { Topics } from "../topics";
import type { Site } from "./site";

export interface Rates {
  imu: number | null;
  ray: number | null;
  cursor: number | null;
  frame: number | null;
}

const KEYS: Record<keyof Rates, keyof Topics> = {
  imu: "users/{user}/imu",
  ray: "users/{user}/ray",
  cursor: "users/{user}/cursor",
  frame: "strips/frame",
};

/**
 * Messages a second that left their writers, along the chain from the wrist of `user` to the light; null: none
 * writes. Services that all share count those of all, so theirs are shared out among `people`.
 */
export function rates(accounts: Iterable<Health>, user: string, people: number): Rates {
  const found: Rates = { imu: null, ray: null, cursor: null, frame: null };
  for (const account of accounts) {
    if (account.user && account.user !== user) continue;
    for (const { key, direction, rate_hz: rate } of account.keys) {
      if (direction !== "out") continue;
      for (const name of Object.keys(KEYS) as (keyof Rates)[]) {
        if (key !== KEYS[name]) continue;
        const isShared = !account.user && key.includes("{user}");
        found[name] = (found[name] ?? 0) + (isShared ? rate / Math.max(1, people) : rate);
      }
    }
  }
  return found;
}

export interface Losses {
  /** Newer ones came before they were read, or a queue was full. */
  dropped: number;
  /** Events that never arrived. */
  lost: number;
  invalid: number;
  /** Handlers that raised. */
  errors: number;
}

/** Since each service's start. */
export function losses(accounts: Iterable<Health>): Losses {
  const total: Losses = { dropped: 0, lost: 0, invalid: 0, errors: 0 };
  for (const { keys, errors } of accounts) {
    total.errors += errors;
    for (const key of keys) {
      total.dropped += key.dropped;
      total.lost += key.lost;
      total.invalid += key.invalid;
    }
  }
  return total;
}

/** A figure of a service by name, such as the localizer's `yaw drift`. */
export function figureOf(health: Health | undefined, name: string): number | null {
  return health?.figures.find((each) => each.name === name)?.value ?? null;
}

/** Value of a slider with which `service` has started, or null if it is not there. */
export function initialOf({ health }: Pick<Site, "health">, service: string, name: string): number | null {
  return figureOf(health.get(service), `default ${name}`);
}
