/** What is selected, about to be, or under a cursor: outlines, rings in the owner's pattern, gauges. */

import {
  cssColor,
  kindColor,
  kindLetter,
  visibleColor,
  type Pattern,
  type Rgb,
} from "../geometry/appearance";
import type { Vec3 } from "../geometry/vec";
import { currentBoxColor, WHITE } from "../site/box_color";
import { holdersOf, ownersOf, type Site } from "../site/site";
import { NAME, type Labels } from "./labels";
import type { Marks } from "./marks";
import type { Thing, Things } from "./things";

const REFUSED: Rgb = [255, 70, 60];
/** Colour of what lies behind a gauge in the light theme. */
const GAUGE_BACK: Rgb = [20, 25, 32];
/** Heights of a gauge above a thing, m: above the name of a box. */
const GAUGE_ABOVE_M = 0.2;
const GAUGE_ABOVE_BOX_M = 0.34;
/** Radius of the first gauge at a thing, m, and how much each further one is wider. */
const GAUGE_RADIUS_M = 0.1;
const GAUGE_STEP_M = 0.035;
/** Gauges of so many people are beside each other; then the radii begin again. */
const GAUGE_RADII = 3;
const GAUGE_BACK_SCALE = 1.06;
/** Height of a name above what it names, m. */
const NAME_ABOVE_M = 0.2;
const NAME_ABOVE_BOX_M = 0.08;
const NAME_ABOVE_SEGMENT_M = 0.06;
const TAKEN_ABOVE_GAUGE_M = 0.16;
const BAY_NAME_M = 0.22;
/** Mark on the floor below a robot. */
const ROBOT_RADIUS_M = 0.12;
const ROBOT_HEIGHT_M = 0.01;
/** A reserved object's ring is dimmer than a selected one's. */
const RESERVED_ALPHA = 0.7;

/** What the states of things are drawn with. */
export interface StateBrushes {
  readonly things: Things;
  readonly marks: Marks;
  readonly labels: Labels;
  readonly isDark: boolean;
}

/** Draw the state of every thing of `site`. */
export function drawStates(site: Site, brushes: StateBrushes): void {
  const { things } = brushes;
  things.beginOutlines();
  drawSelected(site, brushes);
  drawReserved(site, brushes);
  things.endOutlines();
  things.paintBoxes(({ object }) => currentBoxColor(site, object));
  drawHovers(site, brushes);
  drawNames(brushes);
}

/** Colour of a person on this theme. */
function colorOf(site: Site, user: string, isDark: boolean): Rgb {
  return visibleColor(site.people.get(user)?.profile?.cursor_color ?? WHITE, isDark);
}

function drawSelected(site: Site, { things, marks, isDark }: StateBrushes): void {
  for (const [id, user] of ownersOf(site)) {
    const thing = things.byId.get(id);
    if (!thing) continue;
    const color = colorOf(site, user, isDark);
    things.outline(thing, color);
    ring(thing, marks, color, site.people.get(user)?.profile?.pattern ?? "solid", 1);
  }
}

function drawReserved(site: Site, { things, marks, isDark }: StateBrushes): void {
  for (const [id, user] of holdersOf(site)) {
    const thing = things.byId.get(id);
    if (thing) ring(thing, marks, colorOf(site, user, isDark), "dotted", RESERVED_ALPHA);
  }
}

/** The gauges of people over what they point at, and who has taken it. */
function drawHovers(site: Site, { things, marks, labels, isDark }: StateBrushes): void {
  let rank = 0;
  for (const { hover, user } of site.people.values()) {
    const thing = hover?.object_id ? things.byId.get(hover.object_id) : undefined;
    if (!thing || !hover) continue;
    const { at } = thing.placed;
    const color = colorOf(site, user, isDark);
    const up = gaugeHeight(thing);
    const shown = hover.action === "refuse" ? REFUSED : color;
    const radius = GAUGE_RADIUS_M + GAUGE_STEP_M * (rank % GAUGE_RADII);
    rank += 1;
    if (!isDark) {
      const back = { faces: true, thick: 0.34, alpha: 0.4 };
      marks.add(at, radius * GAUGE_BACK_SCALE, GAUGE_BACK, back, up);
    }
    marks.add(at, radius, shown, { faces: true, thick: 0.28, progress: hover.progress }, up);
    if (!hover.taken_by || hover.action !== "refuse") continue;
    const text = `taken by ${hover.taken_by}`;
    labels.add(`taken ${user}`, at, up + TAKEN_ABOVE_GAUGE_M, [{ text }], cssColor(color), 1);
  }
}

function gaugeHeight({ up, size, form }: Thing): number {
  return up + size[2] / 2 + (form === "box" ? GAUGE_ABOVE_BOX_M : GAUGE_ABOVE_M);
}

/** Names of boxes and robots, letters of all else but packages, which have theirs on them. */
function drawNames({ things, marks, labels }: StateBrushes): void {
  const all = [...things.byId.values()];
  const parts = partsOf(all.filter(({ form, object }) => form === "box" && !object.press));
  let number = 0;
  for (const thing of all) {
    if (parts.has(thing) || thing.form === "package") continue;
    if (thing.form === "box") {
      number += 1;
      nameBox(thing, labels, number);
      continue;
    }
    const { kind, id } = thing.object;
    const { at } = thing.placed;
    const letter = { text: kindLetter(kind) || "?", color: kindColor(kind) };
    const up = thing.form === "segment" ? NAME_ABOVE_SEGMENT_M : NAME_ABOVE_M;
    labels.add(`thing ${id}`, at, up, thing.form === "robot" ? [{ text: id }] : [letter]);
    if (thing.form === "robot")
      marks.add([at[0], at[1], 0], ROBOT_RADIUS_M, WHITE, { thick: 0.12, alpha: 0.4 }, ROBOT_HEIGHT_M);
  }
}

/** @param number of the box, which stands for its name where there is no room. */
function nameBox({ object, placed, size }: Thing, labels: Labels, number: number): void {
  const { kind, id } = object;
  const up = size[2] / 2 + NAME_ABOVE_BOX_M;
  labels.add(`thing ${id}`, placed.at, up, [{ text: kind || id }], "", NAME, number);
}

/** Boxes of one kind that are nearer to each other have one name, m: links of an arm. */
const APART_M = 0.2;

/** Boxes without a name of their own: each is part of a whole of its kind, whose topmost box has the name. */
export function partsOf<Box extends Pick<Thing, "object" | "placed" | "size">>(
  boxes: readonly Box[],
): Set<Box> {
  const parts = new Set<Box>();
  const kinds = new Map<string, Box[]>();
  for (const box of boxes) kinds.set(box.object.kind, [...(kinds.get(box.object.kind) ?? []), box]);
  for (const [kind, alike] of kinds) {
    if (kind === "" || alike.length === 1) continue; // as most things: each has a name of its own
    for (const whole of wholesOf(alike)) {
      const named = whole.reduce((top, each) => (each.placed.at[2] > top.placed.at[2] ? each : top));
      for (const each of whole) if (each !== named) parts.add(each);
    }
  }
  return parts;
}

/** Boxes that are connected, directly or by others, as one group each. */
function wholesOf<Box extends Pick<Thing, "placed" | "size">>(boxes: readonly Box[]): Box[][] {
  const wholes: Box[][] = [];
  for (const box of boxes) {
    const near = wholes.filter((whole) => whole.some((each) => gap(each, box) < APART_M));
    for (const whole of near) wholes.splice(wholes.indexOf(whole), 1);
    wholes.push([box, ...near.flat()]);
  }
  return wholes;
}

function gap(
  { placed: one, size }: Pick<Thing, "placed" | "size">,
  { placed: other }: Pick<Thing, "placed">,
): number {
  return Math.hypot(...one.at.map((part, axis) => part - other.at[axis]!)) - Math.max(...size);
}

/** What came out at each bay, by kind. */
export function drawCounts(site: Site, bays: readonly { id: string; at: Vec3 }[], labels: Labels): void {
  for (const { id, at } of bays) {
    const out = site.conveyor?.bays.filter(({ bay }) => bay === id) ?? [];
    labels.add(
      `bay ${id}`,
      at,
      BAY_NAME_M,
      [
        { text: /^bay/i.test(id) ? id : `Bay ${id}` },
        ...out.map(({ kind, count }) => ({ text: `${kindLetter(kind)} ${count}`, color: kindColor(kind) })),
      ],
      "",
      1,
    );
  }
}

function ring(thing: Thing, marks: Marks, color: Rgb, pattern: Pattern, alpha: number): void {
  const { form, placed, size, up } = thing;
  if (form === "package" || form === "box") {
    marks.add(
      placed.at,
      0.62 * Math.max(size[0], size[1]),
      color,
      { pattern, thick: 0.17, alpha },
      up + size[2] / 2 + 0.035,
    );
  } else {
    marks.add(
      placed.at,
      0.13,
      color,
      { pattern, faces: true, thick: 0.2, alpha },
      form === "segment" ? 0.1 : 0,
    );
  }
}
