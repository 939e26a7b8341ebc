/** The fields of the chosen item: each says beside itself what is wrong with it. */

import { el, renew, write } from "../dom";
import { nameProblem, numberIn, type Finding, type Item, type Items, type Limits } from "./model";
import { MOST_HANDLES } from "./canvas";
import { lengthOf, mm, verticesOf, withLength, withVertices, type Vec } from "./shape";

/** A field; `key`: of the item's entry, whose findings stand beside it. */
interface Field {
  label: string;
  key: string;
  text: string;
  /** Instead of free text: values and what they are called. */
  options?: readonly (readonly [string, string])[];
  /** The item with that text, or what is wrong with it. */
  apply(text: string): Item | string;
}

/** Fields side by side, under a title that may be "". */
type Row = readonly [string, readonly Field[]];

const METRES: Limits = { least: -1000, most: 1000 };
const LENGTH: Limits = { least: 0.001, most: 1000 };
const PIXELS: Limits = { least: 1, most: 4096, isWhole: true };
const DEGREES: Limits = { least: -360, most: 360 };

function rowsOf(item: Item, items: Items): Row[] {
  const { section, value } = item;
  const number = (
    label: string,
    key: string,
    now: number,
    limits: Limits,
    put: (value: number) => Item,
  ): Field => ({
    label,
    key,
    text: String(mm(now)),
    apply: (text) => {
      const found = numberIn(text, limits);
      return typeof found === "string" ? found : put(found);
    },
  });
  const holding = (key: string, held: unknown): Item => ({ ...item, value: { ...value, [key]: held } });
  const name: Field = {
    label: "Name",
    key: "name",
    text: item.name,
    apply: (text) => nameProblem(items, item, text.trim()) || { ...item, name: text.trim() },
  };
  const vertices = verticesOf(item);
  const place = (at: Vec, index: number): Field[] =>
    (["x", "y", "z"] as const).map((axis, i) =>
      number(
        `${axis}, m`,
        section === "strips" ? "line" : section === "lamps" ? "position" : "center",
        at[i]!,
        METRES,
        (found) =>
          withVertices(
            item,
            vertices.map((vertex, n) =>
              n === index ? (vertex.map((part, k) => (k === i ? found : part)) as unknown as Vec) : vertex,
            ),
          ),
      ),
    );
  if (section === "strips") {
    const ends =
      vertices.length > MOST_HANDLES
        ? []
        : vertices.map((at, i): Row => [
            i === 0 ? "First end" : i === vertices.length - 1 ? "Last end" : `Corner ${i}`,
            place(at, i),
          ]);
    return [
      ["", [name]],
      [
        "",
        [
          number("Length, m", "length", lengthOf(item), LENGTH, (found) => withLength(item, found)),
          number("Pixels", "pixels", Number(value["pixels"]), PIXELS, (found) => holding("pixels", found)),
        ],
      ],
      [
        "",
        [
          {
            label: "Pixel 0 is at",
            key: "direction",
            text: String(value["direction"] ?? 1),
            options: [
              ["1", "the first end"],
              ["-1", "the last end"],
            ],
            apply: (text) => holding("direction", Number(text)),
          },
        ],
      ],
      ...ends,
    ];
  }
  const rows: Row[] = [["", [name]], ...vertices.map((at, i): Row => ["Place", place(at, i)])];
  const size = value["size"] as readonly number[] | undefined;
  if (size && vertices.length) {
    rows.push([
      "Size",
      size.map((now, i) =>
        number(
          `${(size.length === 2 ? ["wide", "high"] : ["long", "deep", "high"])[i]}, m`,
          "size",
          now,
          LENGTH,
          (found) =>
            holding(
              "size",
              size.map((each, n) => (n === i ? found : each)),
            ),
        ),
      ),
    ]);
  }
  if (vertices.length && (section === "boxes" || section === "things"))
    rows.push([
      "",
      [
        number("Turned, °", "yaw_deg", Number(value["yaw_deg"] ?? 0), DEGREES, (found) =>
          holding("yaw_deg", found),
        ),
      ],
    ]);
  return rows;
}

export class Fields {
  readonly element = el("div", { className: "edit-fields" });
  private readonly inputs: {
    input: HTMLInputElement | HTMLSelectElement;
    problem: HTMLElement;
    key: string;
  }[] = [];
  private readonly general = el("div", { className: "edit-findings" });
  private fields: readonly Field[] = [];

  /** @param put called with an item that was changed here. */
  constructor(private readonly put: (item: Item) => void) {}

  update(item: Item | null, items: Items, findings: ReadonlyMap<string, readonly Finding[]>): void {
    const rows = item ? rowsOf(item, items) : [];
    this.fields = rows.flatMap(([, fields]) => fields);
    renew(
      this.element,
      item ? `${item.id} ${rows.map(([title, fields]) => title + fields.length).join(" ")}` : "",
      () => {
        this.inputs.length = 0;
        let index = 0;
        return [
          this.general,
          ...rows.map(([title, fields]) =>
            el(
              title ? "fieldset" : "div",
              { className: "edit-row plain" },
              title ? el("legend", { text: title }) : null,
              ...fields.map((field) => this.field(field, index++)),
            ),
          ),
        ];
      },
    );
    this.fields.forEach((field, i) => {
      const { input, key } = this.inputs[i]!;
      const isTyping = input === document.activeElement && input.value !== input.dataset["text"];
      if (!isTyping && input.value !== field.text) input.value = field.text;
      input.dataset["text"] = field.text;
      const isFirst = this.inputs.findIndex((each) => each.key === key) === i;
      if (!isTyping)
        this.tell(i, isFirst ? (findings.get(key) ?? []).map(({ text }) => text).join("; ") : "");
    });
    const shown = new Set(this.fields.map(({ key }) => key));
    const others = [...findings].filter(([key]) => !shown.has(key)).flatMap(([, found]) => found);
    renew(this.general, JSON.stringify(others), () => others.map((each) => findingLine(each, "")));
  }

  private field(field: Field, index: number): HTMLElement {
    const problem = el("span", { className: "edit-problem", id: `edit-problem-${index}`, role: "alert" });
    const attributes = {
      "aria-describedby": problem.id,
      onchange: () => this.commit(index, true),
      oninput: () => this.commit(index, false),
    };
    const input = field.options
      ? el("select", attributes, ...field.options.map(([value, text]) => el("option", { value, text })))
      : el("input", {
          type: "text",
          autocomplete: "off",
          spellcheck: "false",
          inputmode: field.key === "name" ? "text" : "decimal",
          ...attributes,
        });
    this.inputs.push({ input, problem, key: field.key });
    return el("label", { className: "edit-field" }, el("span", { text: field.label }), input, problem);
  }

  private commit(index: number, isDone: boolean): void {
    const { input } = this.inputs[index]!;
    const applied = this.fields[index]!.apply(input.value);
    this.tell(index, typeof applied === "string" ? applied : "");
    if (isDone && typeof applied !== "string" && input.value !== input.dataset["text"]) this.put(applied);
  }

  private tell(index: number, text: string): void {
    const { input, problem } = this.inputs[index]!;
    write(problem, text);
    input.setAttribute("aria-invalid", String(text !== ""));
  }
}

/** A finding as a line of text, with whose it is. */
export function findingLine({ severity, text }: Finding, where: string): HTMLElement {
  return el(
    "p",
    { className: `edit-finding edit-is-${severity}` },
    el("strong", { text: severity === "error" ? "Error " : "Warning " }),
    where ? `${where}: ` : "",
    text,
  );
}
