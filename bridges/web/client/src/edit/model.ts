/** The map as it is edited: items in the words of its file, undo, and what differs from the file. Pure. */

/** Sections that are edited. Others are drawn, and stay as they are. */
export const SECTIONS = ["strips", "lamps", "boxes", "things", "planes"] as const;
export type Section = (typeof SECTIONS)[number];

export type Value = Readonly<Record<string, unknown>>;

/** An entry; `id` is its own as long as the editor is open, whatever its name. */
export interface Item {
  readonly id: number;
  readonly section: Section;
  readonly name: string;
  readonly value: Value;
}

export type Items = readonly Item[];

/** An edit as the server takes it; `name` is that in the file. */
export type Edit =
  | { op: "set"; section: Section; name: string; key: string; value: unknown }
  | { op: "add"; section: Section; name: string; value: Value }
  | { op: "remove"; section: Section; name: string }
  | { op: "rename"; section: Section; name: string; to: string };

export function itemsOf(sections: Readonly<Record<string, unknown>>): Items {
  let id = 0;
  return SECTIONS.flatMap((section) =>
    Object.entries((sections[section] ?? {}) as Record<string, Value>).map(([name, value]) => ({
      id: id++,
      section,
      name,
      value,
    })),
  );
}

/** What makes `now` of `base`. */
export function editsBetween(base: Items, now: Items): Edit[] {
  const edits: Edit[] = [];
  const left = new Map(now.map((item) => [item.id, item]));
  for (const old of base) {
    const { section, name } = old;
    const item = left.get(old.id);
    left.delete(old.id);
    if (!item) {
      edits.push({ op: "remove", section, name });
      continue;
    }
    if (item.name !== name) edits.push({ op: "rename", section, name, to: item.name });
    for (const key of new Set([...Object.keys(old.value), ...Object.keys(item.value)])) {
      if (JSON.stringify(old.value[key]) !== JSON.stringify(item.value[key]))
        edits.push({ op: "set", section, name, key, value: item.value[key] ?? null });
    }
  }
  for (const { section, name, value } of left.values()) edits.push({ op: "add", section, name, value });
  return edits;
}

/** The items, and all that they were before. */
export class History {
  private readonly past: Items[] = [];
  private future: Items[] = [];
  private gesture = "";

  constructor(private now: Items) {}

  get items(): Items {
    return this.now;
  }

  get canUndo(): boolean {
    return this.past.length > 0;
  }

  get canRedo(): boolean {
    return this.future.length > 0;
  }

  /** Change to `items`. Changes one after the other of the same `gesture`, unless it is "", are undone at once. */
  put(items: Items, gesture = ""): void {
    if (!gesture || gesture !== this.gesture) this.past.push(this.now);
    this.gesture = gesture;
    this.future = [];
    this.now = items;
  }

  undo(): void {
    this.go(this.past, this.future);
  }

  redo(): void {
    this.go(this.future, this.past);
  }

  private go(from: Items[], to: Items[]): void {
    const next = from.pop();
    if (!next) return;
    to.push(this.now);
    this.now = next;
    this.gesture = "";
  }
}

/** Why `item` cannot have that name, or "". */
export function nameProblem(items: Items, item: Pick<Item, "id" | "section">, name: string): string {
  if (!/^\w[\w.-]{0,63}$/.test(name))
    return "A name has 1 to 64 letters, digits, _, - or ., and begins with a letter, digit or _.";
  const isTaken = items.some(
    (other) => other.id !== item.id && other.section === item.section && other.name === name,
  );
  return isTaken ? `There is another one of the name ${name}.` : "";
}

/** A name that no other of the section has. */
export function freeName(items: Items, section: Section, stem: string): string {
  for (let n = 1; ; n++)
    if (!items.some((item) => item.section === section && item.name === `${stem}${n}`)) return `${stem}${n}`;
}

export interface Limits {
  least: number;
  most: number;
  isWhole?: boolean;
}

/** The number in `text`, or a sentence that says why it is none; a comma is a point. */
export function numberIn(text: string, { least, most, isWhole }: Limits): number | string {
  const value = Number(text.trim().replace(",", "."));
  if (!text.trim() || !Number.isFinite(value)) return `Write a number${isWhole ? "" : ", such as 1.25"}.`;
  if (isWhole && !Number.isInteger(value)) return "Write a whole number.";
  if (value < least || value > most) return `Write a number from ${least} to ${most}.`;
  return value;
}

export interface Finding {
  severity: "error" | "warning";
  where: string;
  text: string;
}

/** Findings of an item, by key of its entry ("": of the whole entry); `rest`: those of no item. */
export interface Sorted {
  of(item: Item): ReadonlyMap<string, readonly Finding[]>;
  readonly rest: readonly Finding[];
}

/** Sort `findings`, whose `where` is `section.name` and perhaps a key. Names may have points: the longest counts. */
export function sorted(findings: readonly Finding[], items: Items): Sorted {
  const found = new Map<number, Map<string, Finding[]>>();
  const rest: Finding[] = [];
  for (const finding of findings) {
    const owner = items
      .filter(({ section, name }) => `${finding.where}.`.startsWith(`${section}.${name}.`))
      .sort((a, b) => b.name.length - a.name.length)[0];
    if (!owner) {
      rest.push(finding);
      continue;
    }
    const key = finding.where.slice(`${owner.section}.${owner.name}.`.length).split(".")[0] ?? "";
    const keys = found.get(owner.id) ?? new Map<string, Finding[]>();
    found.set(owner.id, keys.set(key, [...(keys.get(key) ?? []), finding]));
  }
  return { of: (item) => found.get(item.id) ?? new Map(), rest };
}
