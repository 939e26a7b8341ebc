/** The message log, bounded. */

import type { Health, Problem } from "../messages";
import { LOG_LINES, siteNow, type LogLine, type Site } from "./site";

/** Write one line, of now (of the past, if that is played) or of `at` (Unix time, ms). */
export function note(
  site: Site,
  severity: LogLine["severity"],
  who: string,
  text: string,
  at = site.timeline ? siteNow(site) / 1e6 : Date.now(),
): void {
  site.log.push({ id: site.logged, at, severity, who, text });
  site.logged += 1;
  if (site.log.length > LOG_LINES) site.log.splice(0, site.log.length - LOG_LINES);
}

/** The problems that a service reports, also one of an older release, which has sentences only. */
export const problemsOf = ({ problems, warnings }: Health): readonly Problem[] =>
  problems.length
    ? problems
    : warnings.map((sentence) => ({ code: "other", sentence, severity: "warning", subject: "", topic: "" }));

/** A warning repeated after this pause counts as new, ms. */
const EPISODE_MS = 10_000;

/** Warnings that stand on, often with other figures each second, are one episode each. */
export class Episodes {
  /** When each was heard last, by service and problem. */
  private readonly heard = new Map<string, number>();

  /** Whether an episode begins with this problem, heard `at` (`performance.now()`, ms). */
  isNew(service: string, { code, sentence, subject, topic }: Problem, at: number): boolean {
    for (const [key, last] of this.heard) if (at - last > EPISODE_MS) this.heard.delete(key);
    const key = [service, code, subject, topic, code === "other" ? sentence : ""].join(" ");
    const isNew = !this.heard.has(key);
    this.heard.set(key, at);
    return isNew;
  }
}

/** The lines that have every word of `filter`, newest first, at most `most`. */
export function matching(log: readonly LogLine[], filter: string, most: number): LogLine[] {
  const words = filter.toLowerCase().split(/\s+/).filter(Boolean);
  const found: LogLine[] = [];
  for (let index = log.length - 1; index >= 0 && found.length < most; index -= 1) {
    const line = log[index]!;
    const text = `${line.severity} ${line.who} ${line.text}`.toLowerCase();
    if (words.every((word) => text.includes(word))) found.push(line);
  }
  return found;
}
