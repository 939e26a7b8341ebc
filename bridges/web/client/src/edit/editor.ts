/** The plan editor: a dialog over the page with the map from above, fields, findings, undo and save. */

import type { Controls } from "../controls";
import { el, enable, icon, mark, renew, show, write } from "../dom";
import { Refusal, type Reply } from "../site/asks";
import { isDark } from "../theme";
import { Canvas, titleOf } from "./canvas";
import { Fields, findingLine } from "./fields";
import { FloorPlan } from "./floorplan";
import {
  editsBetween,
  freeName,
  History,
  itemsOf,
  SECTIONS,
  sorted,
  type Edit,
  type Finding,
  type Item,
  type Items,
  type Section,
  type Value,
} from "./model";
import { aboutOrigin, middleOf, mm, moved, turned, verticesOf, withVertices, yawOf, type Vec } from "./shape";
import { level, parallel, snapMove, snapTurn } from "./snap";
import { spreadAlongWalls, unplacedOf } from "./spread";

const CHECK_MS = 400;
/** A save reads, checks and writes the map, and the site takes it; a map with point clouds takes seconds, ms. */
const PATIENCE_MS = 30_000;
/** The server takes messages of 16 KiB. */
const MOST_BYTES = 15_000;
const SNAP_PX = 10;
const STEP_M = 0.01;
const LARGE_STEP_M = 0.1;
const TURN = (5 * Math.PI) / 180;
const SMALL_TURN = Math.PI / 180;
const ARROWS: Record<string, Vec> = {
  ArrowLeft: [-1, 0, 0],
  ArrowRight: [1, 0, 0],
  ArrowUp: [0, 1, 0],
  ArrowDown: [0, -1, 0],
  PageUp: [0, 0, 1],
  PageDown: [0, 0, -1],
};
const TURNS: Record<string, number> = { "[": TURN, "]": -TURN, "{": SMALL_TURN, "}": -SMALL_TURN };
const NAMES: Record<Section, string> = {
  strips: "Strip",
  lamps: "Lamp",
  boxes: "Box",
  things: "Thing",
  planes: "Wall",
};
const NEW: Record<Section, (x: number, y: number) => Value> = {
  strips: (x, y) => ({
    line: [
      [mm(x - 0.5), y, 1],
      [mm(x + 0.5), y, 1],
    ],
    pixels: 60,
  }),
  lamps: (x, y) => ({ position: [x, y, 1.5] }),
  boxes: (x, y) => ({ center: [x, y, 0.4], size: [0.8, 0.5, 0.8] }),
  things: (x, y) => ({ center: [x, y, 1], size: [0.3, 0.3, 0.3] }),
  planes: (x, y) => ({ center: [x, y, 1.25], normal: [0, -1, 0], size: [3, 2.5] }),
};

/** Rounded to a centimetre, as what is dragged by hand. */
const cmOf = (value: number): number => Math.round(value * 100) / 100;

const spreadText = (count: number): string =>
  count === 1 ? "Place 1 thing along the walls" : `Spread ${count} things along the walls`;

class Editor {
  private history = new History([]);
  private base: Items = [];
  /** Sections of the file with places that are not edited here. */
  private others: string[] = [];
  private file = { path: "", digest: "", shipped: false };
  private findings: readonly Finding[] = [];
  private chosenId = -1;
  private nextId = 0;
  private held: { item: Item; gesture: string } | null = null;
  private gestures = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private turn = 0;
  private isSure = false;
  private mapVersion = -1;
  private readonly canvas: Canvas;
  private readonly fields = new Fields((item) => this.put(item));
  private readonly plan: FloorPlan;
  private readonly path = el("span", { className: "muted edit-path" });
  private readonly status = el("p", { className: "edit-status", role: "status" });
  private readonly count = el("p", { className: "muted" });
  private readonly rest = el("div", { className: "edit-findings" });
  private readonly pick = el("select", {
    id: "edit-pick",
    onchange: () => this.choose(Number(this.pick.value)),
  });
  private readonly undo = this.button("Undo", "undo", () => this.back(true), "Control+Z");
  private readonly redo = this.button("Redo", "undo", () => this.back(false), "Control+Shift+Z");
  private readonly save = this.button("Save", "check", () => void this.write(""), "Control+S");
  private readonly again = this.button("Load again, without my changes", "download", () => void this.load());
  private readonly spread = this.button("", "floor", () => this.spreadThings());
  private readonly copy = el("input", {
    type: "text",
    id: "edit-copy",
    autocomplete: "off",
    spellcheck: "false",
    "aria-describedby": "edit-copy-problem",
  });
  private readonly copyProblem = el("span", {
    className: "edit-problem",
    id: "edit-copy-problem",
    role: "alert",
  });
  private readonly tools = el(
    "div",
    { className: "edit-tools" },
    this.button("Parallel to the nearest", "sliders", () => this.snap(parallel)),
    this.button("Level with the nearest", "floor", () => this.snap(leveled)),
    this.button("Make it the origin", "place", () => this.makeOrigin()),
    this.button("Remove", "clear", () => this.remove(), "Delete"),
  );
  private readonly dialog = el("dialog", { className: "editor", "aria-labelledby": "edit-title" });

  constructor(private readonly controls: Controls) {
    const stage = el("div", { className: "edit-stage" });
    this.save.classList.add("primary");
    this.redo.classList.add("edit-redo");
    this.dialog.append(
      el(
        "header",
        {},
        el("h2", { id: "edit-title", text: "Edit the map" }),
        this.path,
        this.undo,
        this.redo,
        this.save,
        this.button("Close", "close", () => this.close()),
      ),
      stage,
      el(
        "div",
        { className: "edit-side" },
        this.status,
        this.again,
        this.spread,
        el("label", { className: "edit-field" }, el("span", { text: "What to edit" }), this.pick),
        el(
          "div",
          { className: "edit-tools", role: "group", "aria-label": "Add" },
          ...SECTIONS.map((section) => this.button(NAMES[section], "plus", () => this.add(section))),
        ),
        this.fields.element,
        this.tools,
        this.count,
        this.rest,
        el(
          "label",
          { className: "edit-field" },
          el("span", { text: "Save as a copy named" }),
          this.copy,
          this.copyProblem,
        ),
        this.button("Save as a copy", "download", () => void this.write(this.copy.value.trim())),
        (this.plan = new FloorPlan(
          (picture) => this.canvas.setPicture(picture),
          () => this.canvas.frame,
        )).element,
        el("p", {
          className: "muted",
          text: "Tab: next thing. Arrows: 1 cm, with Shift 10 cm. Page up and down: height. [ and ]: turn by 5°, { and } by 1°. Delete: remove. Ctrl+Z: undo. Dragging snaps to walls and strips, with Alt it does not.",
        }),
      ),
    );
    this.canvas = new Canvas(
      stage,
      {
        choose: (id) => this.choose(id),
        drag: (...drag) => this.drag(...drag),
        dropped: () => (this.held = null),
        key: (event) => this.key(event),
        click: (at) => this.click(at),
      },
      isDark(controls.settings.theme),
    );
    this.dialog.addEventListener("cancel", (event) => {
      event.preventDefault();
      this.close();
    });
    this.dialog.addEventListener("keydown", (event) => this.command(event));
  }

  async open(): Promise<void> {
    if (!(await this.load())) return;
    document.body.append(this.dialog);
    this.dialog.showModal();
    addEventListener("beforeunload", this.unload);
    this.refresh();
  }

  private readonly unload = (event: Event): void => {
    if (this.edits.length) event.preventDefault();
  };

  private button(name: string, sign: string, press: () => void, keys = ""): HTMLButtonElement {
    return el(
      "button",
      { type: "button", onclick: press, ...(keys && { "aria-keyshortcuts": keys }) },
      icon(sign),
      el("span", { text: name }),
    );
  }

  private get items(): Items {
    return this.history.items;
  }

  private get chosen(): Item | null {
    return this.items.find((item) => item.id === this.chosenId) ?? null;
  }

  private get edits(): Edit[] {
    return editsBetween(this.base, this.items);
  }

  /** Read the map that is in use, without changes made here. */
  private async load(): Promise<boolean> {
    const reply = await this.ask("read_map", {});
    if (!reply) return false;
    this.base = itemsOf(reply["sections"] as Record<string, unknown>);
    this.others = Object.keys(reply["sections"] as object).filter(
      (name) => ![...SECTIONS, "links", "bays"].includes(name),
    );
    this.history = new History(this.base);
    this.nextId = this.base.length;
    this.took(reply);
    this.say(this.file.shipped ? "This map comes with PointIt: save your changes as a copy." : "");
    show(this.again, false);
    this.plan.open(this.file.path);
    return true;
  }

  private took(reply: Reply): void {
    this.file = reply as typeof this.file & Reply;
    this.findings = reply["findings"] as readonly Finding[];
    this.turn += 1; // findings on their way are of another file
    this.refresh();
  }

  private async ask(
    deed: "read_map" | "check_map" | "save_map",
    query: Record<string, unknown>,
  ): Promise<Reply | null> {
    if (JSON.stringify(query).length > MOST_BYTES) {
      this.say("Too many changes at a time: undo some, save, and go on.", true);
      return null;
    }
    try {
      return await this.controls.connection.ask({ deed, query }, PATIENCE_MS);
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      if (this.dialog.open) this.say(error.message, true);
      else this.controls.toasts.show("error", error.message);
      show(this.again, error.isStale);
      return null;
    }
  }

  private async write(name: string): Promise<void> {
    const isCopy = name !== "" || this.file.shipped;
    write(
      this.copyProblem,
      isCopy && !/^\w[\w.-]{0,59}$/.test(name) ? "Give your copy a name of letters, digits, _, - and ." : "",
    );
    if (this.copyProblem.textContent) return this.copy.focus();
    const wanted = this.items;
    const reply = await this.ask("save_map", { edits: this.edits, digest: this.file.digest, name });
    if (!reply) return;
    this.base = wanted;
    this.took(reply);
    this.plan.keepFor(this.file.path);
    this.say(String(reply["message"]));
    this.copy.value = "";
  }

  private async check(): Promise<void> {
    const turn = ++this.turn;
    const reply = await this.ask("check_map", { edits: this.edits, digest: this.file.digest });
    if (!reply || turn !== this.turn) return;
    this.findings = reply["findings"] as readonly Finding[];
    this.refresh();
  }

  private close(): void {
    if (this.edits.length && !this.isSure) {
      this.isSure = true;
      return this.say("There are changes that are not saved. Close again to drop them.", true);
    }
    clearTimeout(this.timer);
    removeEventListener("beforeunload", this.unload);
    this.canvas.dispose();
    this.dialog.close();
    this.dialog.remove();
  }

  private say(text: string, isWrong = false): void {
    write(this.status, text);
    mark(this.status, "data-kind", isWrong ? "wrong" : "info");
  }

  private refresh(): void {
    const { chosen, items } = this;
    const found = sorted(this.findings, items);
    const edits = this.edits.length;
    const errors = this.findings.filter(({ severity }) => severity === "error").length;
    const warnings = this.findings.length - errors;
    const { map, mapVersion } = this.controls.site;
    if (map && mapVersion !== this.mapVersion) this.canvas.setMap(map);
    this.mapVersion = mapVersion;
    this.canvas.draw(items, chosen, found);
    this.fields.update(chosen, items, chosen ? found.of(chosen) : new Map());
    write(this.path, `${this.file.path.replace(/^.*[\\/]/, "")}${edits ? " · changed" : ""}`);
    enable(this.undo, this.history.canUndo);
    enable(this.redo, this.history.canRedo);
    enable(this.save, edits > 0 && !this.file.shipped);
    show(this.tools, chosen !== null);
    const unplaced = unplacedOf(items).length;
    show(this.spread, unplaced > 0);
    write(this.spread.lastElementChild!, spreadText(unplaced));
    write(
      this.count,
      `${errors ? `${errors} error${errors > 1 ? "s" : ""}, ` : ""}${warnings ? `${warnings} warning${warnings > 1 ? "s" : ""}` : errors ? "no warnings" : "No findings"}`,
    );
    renew(
      this.rest,
      JSON.stringify([this.findings, items.map(({ id, name }) => [id, name]), this.chosenId]),
      () => [
        ...found.rest.map((finding) => findingLine(finding, finding.where)),
        ...items
          .filter((item) => item !== chosen && found.of(item).size)
          .map((item) =>
            el(
              "button",
              { type: "button", className: "edit-leads", onclick: () => this.choose(item.id) },
              el(
                "span",
                {},
                ...[...found.of(item).values()].flat().map((finding) => findingLine(finding, titleOf(item))),
              ),
            ),
          ),
      ],
    );
    renew(this.pick, JSON.stringify(items.map(({ id, section, name }) => [id, section, name])), () => [
      el("option", { value: "-1", text: "nothing" }),
      ...SECTIONS.map((section) =>
        el(
          "optgroup",
          { label: `${NAMES[section]}s` },
          ...items
            .filter((item) => item.section === section)
            .map((item) => el("option", { value: item.id, text: item.name })),
        ),
      ),
    ]);
    this.pick.value = String(this.chosenId);
  }

  private choose(id: number): void {
    if (id === this.chosenId) return;
    this.chosenId = id;
    const { chosen } = this;
    if (chosen && !middleOf(chosen)) this.say(`${titleOf(chosen)} is where its light is.`);
    this.refresh();
  }

  /** Replace an item, or all of them. */
  private put(change: Item | Items, gesture = ""): void {
    this.history.put(
      "id" in change ? this.items.map((item) => (item.id === change.id ? change : item)) : change,
      gesture,
    );
    this.changed();
  }

  private changed(): void {
    this.isSure = false;
    this.refresh();
    clearTimeout(this.timer);
    this.timer = setTimeout(() => void this.check(), CHECK_MS);
  }

  private back(isUndo: boolean): void {
    if (isUndo) this.history.undo();
    else this.history.redo();
    this.say(isUndo ? "Undone." : "Done again.");
    this.changed();
  }

  private add(section: Section): void {
    const { x, y } = this.canvas.frame;
    const item = {
      id: this.nextId++,
      section,
      name: freeName(this.items, section, NAMES[section].toLowerCase()),
      value: NEW[section](cmOf(x), cmOf(y)),
    };
    this.chosenId = item.id;
    this.put([...this.items, item]);
    this.canvas.focus(item);
    this.say(`${titleOf(item)} is in the middle of the plan.`);
  }

  /** Give each thing without a place one along the walls; then people drag them to where they are. */
  private spreadThings(): void {
    this.put(spreadAlongWalls(this.items));
    this.say("Drag each thing to where it is.");
  }

  private remove(): void {
    const { chosen } = this;
    if (!chosen) return;
    this.chosenId = -1;
    this.put(this.items.filter((item) => item !== chosen));
    this.say(`${titleOf(chosen)} is removed.`);
    this.canvas.svg.focus();
  }

  private snap(to: (item: Item, items: Items) => { item: Item; to: string } | null): void {
    const { chosen } = this;
    const found = chosen && to(chosen, this.items);
    if (!found) return this.say("There is nothing to go by.");
    this.put(found.item);
    this.say(`As ${found.to}.`);
  }

  /** Move everything so that the chosen item is at x = y = 0; what is not edited here would stay behind. */
  private makeOrigin(): void {
    const { chosen } = this;
    if (!chosen || !middleOf(chosen)) return;
    if (this.others.length)
      return this.say(`The map has ${this.others.join(", ")}, which would stay: use a text editor.`, true);
    this.put(aboutOrigin(this.items, chosen));
    this.say(`${titleOf(chosen)} is at x = y = 0.`);
  }

  private click(at: readonly [number, number]): void {
    if (!this.plan.click(at)) this.choose(-1);
  }

  private drag(
    part: string,
    from: readonly [number, number],
    to: readonly [number, number],
    isFree: boolean,
  ): void {
    const { chosen } = this;
    if (!chosen) return;
    const { scale } = this.canvas.frame;
    const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    if (!this.held) {
      if (Math.hypot(dx, dy) * scale < 3) return;
      this.held = { item: chosen, gesture: `drag ${++this.gestures}` };
    }
    const { item, gesture } = this.held;
    const middle = middleOf(item)!;
    const others = this.items;
    const reach = isFree ? 0 : SNAP_PX / scale;
    if (part === "turn") {
      const by =
        Math.atan2(to[1] - middle[1], to[0] - middle[0]) -
        Math.atan2(from[1] - middle[1], from[0] - middle[0]);
      const found = isFree ? { by, onto: "" } : snapTurn(item, others, by);
      this.put(turned(item, found.by), gesture);
      return this.say(found.onto && `Along ${found.onto}.`);
    }
    const line = verticesOf(item);
    const index = Number(part);
    const held = part ? withVertices(item, [line[index]!, line[index]!]) : item;
    const found = snapMove(held, others, dx, dy, reach);
    const start = verticesOf(held)[0]!;
    const [mx, my] = found.onto
      ? [found.dx, found.dy]
      : [cmOf(start[0] + dx) - start[0], cmOf(start[1] + dy) - start[1]];
    this.put(
      part
        ? withVertices(
            item,
            line.map((at, i) => (i === index ? [at[0] + mx, at[1] + my, at[2]] : at)),
          )
        : moved(item, mx, my),
      gesture,
    );
    this.say(found.onto && `On ${found.onto}.`);
  }

  /** A key on an item in the plan. */
  private key(event: KeyboardEvent): boolean {
    const { chosen } = this;
    const arrow = ARROWS[event.key];
    const turn = TURNS[event.key];
    if (!chosen || ((event.ctrlKey || event.metaKey) && !event.altKey)) return false; // with both: a character of its layout
    const gesture = event.repeat ? `keys ${this.gestures}` : `keys ${++this.gestures}`;
    if (arrow) {
      const step = event.shiftKey ? LARGE_STEP_M : STEP_M;
      const item = moved(chosen, arrow[0] * step, arrow[1] * step, arrow[2] * step);
      const at = middleOf(item)!;
      this.put(item, gesture);
      this.say(`x ${at[0].toFixed(2)}, y ${at[1].toFixed(2)}, z ${at[2].toFixed(2)} m`);
    } else if (turn) {
      const item = turned(chosen, turn);
      const yaw = yawOf(item);
      this.put(item, gesture);
      this.say(yaw === null ? "It has no direction." : `${((yaw * 180) / Math.PI).toFixed(0)}°`);
    } else if (event.key === "Delete" || event.key === "Backspace") this.remove();
    else if (event.key === "Enter") this.fields.element.querySelector("input")?.focus();
    else return false;
    return true;
  }

  /** A key anywhere in the dialog. */
  private command(event: KeyboardEvent): void {
    if (!(event.ctrlKey || event.metaKey) || event.altKey) return;
    const { target } = event;
    const key = event.key.toLowerCase();
    if (target instanceof HTMLInputElement && target.value !== (target.dataset["text"] ?? "") && key !== "s")
      return; // undoes what is typed
    if (key === "z") this.back(!event.shiftKey);
    else if (key === "y") this.back(false);
    else if (key === "s") {
      if (target instanceof HTMLElement) target.blur(); // takes what is typed
      void this.write("");
    } else return;
    event.preventDefault();
  }
}

function leveled(item: Item, items: Items): { item: Item; to: string } | null {
  const found = level(item, items);
  return found && { item: withVertices(item, found.vertices), to: found.to };
}

/** Open the editor over the page. */
export function openEditor(controls: Controls): Promise<void> {
  return new Editor(controls).open();
}
