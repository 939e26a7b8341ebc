/** Why the scene stands still: a service without which it must, and the cause as far as it is known. */

import type { Site } from "./site/site";

/** Visible effect of each service's absence, the most important first. */
const EFFECTS: Readonly<Record<string, string>> = {
  pui: "Cursors and lights do not move",
  selector: "Nothing can be selected",
};
/** How the diagnosis calls one that hangs. */
const SILENT = "is present but has not reported";

/** One sentence for people; empty while all run. */
export function outage({ status }: Pick<Site, "status">): string {
  for (const [service, effect] of Object.entries(EFFECTS)) {
    const isGone = status?.services.some(({ instance, present }) => instance === service && !present) ?? false;
    const cause = status?.findings.find((each) => each.service === service && each.severity === "error" && (isGone || each.sentence.startsWith(SILENT)));
    if (cause) return `${effect}: ${service} ${cause.sentence}${cause.remedy ? `; ${cause.remedy}` : ""}`;
  }
  return "";
}
