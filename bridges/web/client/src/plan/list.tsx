/** The site as a list: for those who do not see the scene or the plan, and for those who select by the keyboard alone. */

import { render } from "preact";
import type { Site } from "../site/site";
import { Icon } from "../ui/elements";
import { lampRows, objectRows, peopleRows, robotRows, type Row } from "./sentences";

/** Minimum interval of updates, ms, so that a screen reader can finish the list. */
const PERIOD_MS = 1000;

export interface ListEvents {
  /** Keep pointing at an object or a lamp, or stop with "". */
  follow(what: string): void;
}

interface Rows {
  people: readonly Row[];
  robots: readonly Row[];
  objects: readonly Row[];
  lamps: readonly Row[];
}

/** A collapsible section below the view with lists of people, robots, objects and lamps. */
export class PlanList {
  readonly element = document.createElement("details");
  private rows: Rows = { people: [], robots: [], objects: [], lamps: [] };
  private toldMs = -Infinity;
  private canPoint = false;
  private followed = "";

  constructor(private readonly events: ListEvents) {
    this.element.className = "plan-list";
    this.element.addEventListener("toggle", () => this.draw());
    this.draw();
  }

  /** Offer pointing, or not; `followed`: current target. */
  offer(canPoint: boolean, followed: string): void {
    if (canPoint === this.canPoint && followed === this.followed) return;
    this.canPoint = canPoint;
    this.followed = followed;
    this.draw();
  }

  /** Tell the site's state, if it is time to. */
  update(site: Site, nowMs = performance.now()): void {
    if (nowMs - this.toldMs < PERIOD_MS) return;
    this.toldMs = nowMs;
    this.rows = {
      people: peopleRows(site),
      robots: robotRows(site),
      objects: objectRows(site),
      lamps: lampRows(site),
    };
    this.draw();
  }

  /** Draw the list. The focus stays in it, at a neighbour if its own row has gone. */
  private draw(): void {
    const { element } = this;
    const focused = document.activeElement;
    const hadFocus = focused instanceof HTMLElement && element.contains(focused);
    const neighbours = hadFocus ? neighboursOf(focused) : [];
    render(
      <ListView
        rows={this.rows}
        isOpen={element.open}
        canPoint={this.canPoint}
        followed={this.followed}
        follow={(key) => this.events.follow(key)}
      />,
      element,
    );
    if (!hadFocus || element.contains(document.activeElement)) return;
    const candidates = [focused, ...neighbours, element.querySelector<HTMLElement>("summary")];
    candidates.find((each) => each?.isConnected && each.offsetParent)?.focus();
  }
}

interface FollowProps {
  canPoint: boolean;
  followed: string;
  follow(key: string): void;
}

interface ListProps extends FollowProps {
  rows: Rows;
  /** While it is closed only the numbers are drawn. */
  isOpen: boolean;
}

export function ListView({ rows, isOpen, ...pointing }: ListProps) {
  const { people, robots, objects, lamps } = rows;
  const listed = [
    `${people.length} ${people.length === 1 ? "person" : "people"}`,
    ...(robots.length ? [count(robots.length, "robot")] : []),
    count(objects.length, "object"),
    count(lamps.length, "lamp"),
  ];
  return (
    <>
      <summary>
        <span>{`As a list: ${listed.join(", ")}`}</span>
        <Icon name="chevron" />
      </summary>
      <p class="plan-hint">
        {pointing.canPoint
          ? "Choose what to point at; the arm stays on it until you choose again or move the mouse over the room."
          : "To point from here, take a person's arm first: choose the mouse as who points."}
      </p>
      <div class="plan-columns">
        {isOpen && (
          <>
            <RowList title="People" rows={people} pointing={null} />
            <RowList title="Robots" rows={robots} pointing={pointing} />
            <RowList title="Objects" rows={objects} pointing={pointing} />
            <RowList title="Lamps" rows={lamps} pointing={pointing} />
          </>
        )}
      </div>
    </>
  );
}

interface RowListProps {
  title: string;
  rows: readonly Row[];
  /** Null for what cannot be pointed at. */
  pointing: FollowProps | null;
}

function RowList({ title, rows, pointing }: RowListProps) {
  const id = `plan-list-${title.toLowerCase()}`;
  if (rows.length === 0) return null;
  return (
    <section>
      <h3 id={id}>{title}</h3>
      <ul aria-labelledby={id}>
        {rows.map((row) => (
          <RowView key={row.key} row={row} pointing={pointing} />
        ))}
      </ul>
    </section>
  );
}

function RowView({ row, pointing }: { row: Row; pointing: FollowProps | null }) {
  const { key, name, text } = row;
  const isFollowed = pointing?.followed === key;
  return (
    <li class={isFollowed ? "plan-followed" : undefined}>
      <strong>{name}</strong> <span>{text}</span>{" "}
      {pointing && (
        <button
          type="button"
          aria-label={`Point at ${name}`}
          aria-pressed={isFollowed}
          hidden={!pointing.canPoint}
          onClick={() => pointing.follow(isFollowed ? "" : key)}
        >
          Point at
        </button>
      )}
    </li>
  );
}

function count(number: number, noun: string): string {
  return `${number} ${noun}${number === 1 ? "" : "s"}`;
}

/** Buttons of the rows beside that of `control`, the next one first. */
function neighboursOf(control: HTMLElement): readonly (HTMLElement | null)[] {
  const row = control.closest("li");
  const siblings = [row?.nextElementSibling, row?.previousElementSibling];
  return siblings.map((each) => each?.querySelector<HTMLElement>("button") ?? null);
}
