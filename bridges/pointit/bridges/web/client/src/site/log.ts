/** The message log: what happened, bounded. */

import { LOG_LINES, type LogLine, type Site } from "./site";

/** Write one line. */
export function note(site: Site, severity: LogLine["severity"], who: string, text: string): void {
  site.log.push({ at: Date.now(), severity, who, text });
  site.logged += 1;
  if (site.log.length > LOG_LINES) site.log.splice(0, site.log.length - LOG_LINES);
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
