/** The site as a list: for those who do not see the scene or the plan, and for those who select by the keyboard alone. */

import { icon, write } from "../dom";
import type { Site } from "../site/site";
import { lampRows, objectRows, peopleRows, robotRows, type Row } from "./sentences";

/** Minimum interval of updates, ms, so that a screen reader can finish the list. */
const EVERY_MS = 1000;

export interface ListEvents {
  /** Keep pointing at an object or a lamp, or stop with "". */
  follow(what: string): void;
}

interface Line {
  item: HTMLLIElement;
  name: HTMLElement;
  text: HTMLElement;
  button: HTMLButtonElement | null;
}

/** A collapsible section below the view with lists of people, robots, objects and lamps. */
export class PlanList {
  readonly element = document.createElement("details");
  private readonly summary = document.createElement("summary");
  private readonly count = document.createElement("span");
  private readonly hint = document.createElement("p");
  private readonly lists = new Map<
    string,
    { list: HTMLUListElement; head: HTMLElement; lines: Map<string, Line> }
  >();
  private told = -Infinity;
  private canPoint = false;
  private followed = "";

  constructor(private readonly events: ListEvents) {
    this.element.className = "plan-list";
    this.hint.className = "plan-hint";
    this.summary.append(this.count, icon("chevron"));
    this.element.append(this.summary, this.hint);
    const columns = document.createElement("div");
    columns.className = "plan-columns";
    this.element.append(columns);
    for (const title of ["People", "Robots", "Objects", "Lamps"]) {
      const section = document.createElement("section");
      const head = document.createElement("h3");
      const list = document.createElement("ul");
      head.textContent = title;
      head.id = `plan-list-${title.toLowerCase()}`;
      list.setAttribute("aria-labelledby", head.id);
      section.append(head, list);
      columns.append(section);
      this.lists.set(title, { list, head, lines: new Map() });
    }
    this.say();
  }

  /** Offer pointing, or not; `followed`: current target. */
  offer(canPoint: boolean, followed: string): void {
    if (canPoint === this.canPoint && followed === this.followed) return;
    [this.canPoint, this.followed] = [canPoint, followed];
    for (const { lines } of this.lists.values()) for (const [key, line] of lines) this.dress(key, line);
    this.say();
  }

  /** Tell the site's state, if it is time to. */
  update(site: Site, now = performance.now()): void {
    if (now - this.told < EVERY_MS) return;
    this.told = now;
    const people = peopleRows(site);
    const robots = robotRows(site);
    const objects = objectRows(site);
    const lamps = lampRows(site);
    const count = (many: number, one: string) => `${many} ${one}${many === 1 ? "" : "s"}`;
    const listed = [
      `${people.length} ${people.length === 1 ? "person" : "people"}`,
      ...(robots.length ? [count(robots.length, "robot")] : []),
      count(objects.length, "object"),
      count(lamps.length, "lamp"),
    ];
    write(this.count, `As a list: ${listed.join(", ")}`);
    if (!this.element.open) return;
    this.fill("People", people, false);
    this.fill("Robots", robots, true);
    this.fill("Objects", objects, true);
    this.fill("Lamps", lamps, true);
  }

  private fill(title: string, rows: readonly Row[], canBeAimedAt: boolean): void {
    const { list, head, lines } = this.lists.get(title)!;
    head.parentElement!.hidden = rows.length === 0;
    const kept = new Set(rows.map(({ key }) => key));
    for (const [key, line] of lines) {
      if (kept.has(key)) continue;
      if (line.item.contains(document.activeElement)) neighbour(line.item)?.focus();
      line.item.remove();
      lines.delete(key);
    }
    rows.forEach((row, i) => {
      const line = lines.get(row.key) ?? this.line(row, canBeAimedAt);
      lines.set(row.key, line);
      if (list.children[i] !== line.item && !line.item.contains(document.activeElement))
        list.insertBefore(line.item, list.children[i] ?? null);
      write(line.name, row.name);
      write(line.text, row.text);
    });
  }

  private line(row: Row, canBeAimedAt: boolean): Line {
    const item = document.createElement("li");
    const name = document.createElement("strong");
    const text = document.createElement("span");
    item.append(name, " ", text);
    let button: HTMLButtonElement | null = null;
    if (canBeAimedAt) {
      button = document.createElement("button");
      button.type = "button";
      button.addEventListener("click", () => this.events.follow(this.followed === row.key ? "" : row.key));
      button.setAttribute("aria-label", `Point at ${row.name}`);
      button.textContent = "Point at"; // its name begins with what is seen
      item.append(" ", button);
    }
    const line = { item, name, text, button };
    this.dress(row.key, line);
    return line;
  }

  private dress(key: string, { button, item }: Line): void {
    if (!button) return;
    button.hidden = !this.canPoint;
    button.setAttribute("aria-pressed", String(this.followed === key));
    item.classList.toggle("plan-followed", this.followed === key);
  }

  private say(): void {
    write(
      this.hint,
      this.canPoint
        ? "Choose what to point at; the arm stays on it until you choose again or move the mouse over the room."
        : "To point from here, take a person's arm first: choose the mouse as who points.",
    );
  }
}

function neighbour(item: Element): HTMLElement | null {
  const other = item.nextElementSibling ?? item.previousElementSibling;
  return (
    other?.querySelector<HTMLElement>("button:not([hidden])") ??
    item.closest("details")?.querySelector("summary") ??
    null
  );
}
