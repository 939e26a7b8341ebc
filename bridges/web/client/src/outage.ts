/** Reason why the scene stands still: a service without which it must, and the cause as far as it is known. */

import { capital } from "./format";
import type { Site } from "./site/site";
import type { FindingLine } from "./wire";

/** Visible effect of each service's absence, the most important first. */
const EFFECTS: Readonly<Record<string, string>> = {
  pui: "Cursors and lights do not move",
  selector: "Nothing can be selected",
};
/** Code of the diagnosis for one that hangs. */
const SILENT = "silent";

type Known = Pick<Site, "status">;

/** Whether the site as a whole is out of reach. */
export function isCutOff(site: Known): boolean {
  return site.status?.run === "runs" && whole(site)?.severity === "error";
}

/** Warnings and errors that do not follow from others. */
export function causes({ status }: Known): readonly FindingLine[] {
  return status?.findings.filter(({ severity, follows }) => severity !== "note" && !follows) ?? [];
}

function whole({ status }: Known): FindingLine | undefined {
  const all = status?.findings ?? [];
  return all.some(({ follows }) => follows)
    ? all.find(({ service, follows }) => !service && !follows)
    : undefined;
}

/** What stands still, in a few words, and why, with the remedy. */
export interface Outage {
  readonly title: string;
  readonly detail: string;
}

/** What stands still; null while all run. */
export function outage({ status }: Known): Outage | null {
  if (status && status.run !== "runs") return null; // services leave or start as they should
  const site = whole({ status });
  if (site) return { title: "The site is out of reach.", detail: causeText("", site) };
  for (const [service, effect] of Object.entries(EFFECTS)) {
    const isGone =
      status?.services.some(({ instance, present }) => instance === service && !present) ?? false;
    const cause = status?.findings.find(
      (each) => each.service === service && each.severity === "error" && (isGone || each.code === SILENT),
    );
    if (cause) return { title: `${effect}:`, detail: causeText(service, cause) };
  }
  return null;
}

function causeText(service: string, { sentence, remedy }: FindingLine): string {
  const cause = service ? `${service} ${sentence}` : capital(sentence);
  return remedy ? `${cause}; ${remedy}` : cause;
}
