/** What another scenario would end: pointing of people, not of simulated ones, and what they have selected. */

import type { Controls } from "./controls";
import { steeredBy } from "./site/robots";

const MOVERS = { mouse: "a mouse", phone: "a phone", headset: "a headset", own: "their own device" } as const;

/** Sentences about what would be lost. Empty if nothing is lost. */
export function losses(controls: Controls): string[] {
  const { site } = controls;
  const lost: string[] = [];
  for (const { user, line } of site.people.values()) {
    const mover = line?.moved_by ?? "own";
    const isMine = user === controls.mine?.user;
    if (mover === "own" && controls.sourceOf(user) === "simulation") continue;
    const selected =
      site.selection?.objects.filter(
        (each) => each.user === user && (!isMine || controls.hasSelected(each.id)),
      ).length ?? 0;
    const robot = steeredBy(site, user)?.name;
    const has = [selected === 1 ? "1 selection" : selected ? `${selected} selections` : "", robot ?? ""]
      .filter(Boolean)
      .join(" and ");
    lost.push(
      `${isMine ? `You point as ${user}` : `${user} points with ${MOVERS[mover]}`}${has ? `, and ${isMine ? "lose" : "loses"} ${has}` : ""}.`,
    );
  }
  const others = (site.status?.viewers ?? 1) - 1;
  if (lost.length && others > 0)
    lost.push(`${others === 1 ? "Another page shows" : `${others} other pages show`} it, too.`);
  return lost;
}
