/** The side panel: control, set-up and health, as tabs. */

import type { Controls } from "../controls";
import { el, icon, mark, show, write } from "../dom";
import type { PanelPart } from "./panel_part";

export interface Tab {
  name: string;
  icon: string;
  parts: readonly PanelPart[];
}

export interface Panel {
  update(): void;
  /** Show the next tab. */
  turn(): void;
  open(index: number): void;
  /** A number at a tab's name; 0: none. */
  count(index: number, count: number, meaning: string): void;
}

/** Fill `host` with tabs. */
export function makePanel(host: HTMLElement, controls: Controls, tabs: readonly Tab[]): Panel {
  let current = 0;
  const badges = tabs.map(() => el("span", { className: "count", hidden: true }));
  const heads = tabs.map((tab, index) =>
    el(
      "button",
      {
        type: "button",
        role: "tab",
        id: `tab-${index}`,
        "aria-controls": `page-${index}`,
        onclick: () => open(index),
        onkeydown: (event) => travel(event as KeyboardEvent),
      },
      icon(tab.icon),
      el("span", { text: tab.name }),
      badges[index]!,
    ),
  );
  const pages = tabs.map((tab, index) =>
    el(
      "div",
      {
        role: "tabpanel",
        id: `page-${index}`,
        "aria-labelledby": `tab-${index}`,
        className: "page",
        tabindex: 0,
      },
      ...tab.parts.map((part) => part.element),
    ),
  );
  const handle = el("button", {
    type: "button",
    className: "handle",
    "aria-expanded": "true",
    "aria-label": "Controls",
    onclick: () => {
      const isLow = host.classList.toggle("low");
      mark(handle, "aria-expanded", String(!isLow));
    },
  });
  host.append(
    handle,
    el("div", { role: "tablist", "aria-label": "Panel", className: "tabs" }, ...heads),
    ...pages,
  );

  function open(index: number): void {
    current = index;
    heads.forEach((head, at) => {
      mark(head, "aria-selected", String(at === index));
      mark(head, "tabindex", at === index ? "0" : "-1");
      show(pages[at]!, at === index);
    });
    host.classList.remove("low");
    mark(handle, "aria-expanded", "true");
    controls.changed();
  }

  /** The next tab that has something to show, or the one before. */
  function turn(by: 1 | -1): void {
    let next = current;
    do next = (next + by + tabs.length) % tabs.length;
    while (heads[next]!.hidden && next !== current);
    open(next);
  }

  function travel(event: KeyboardEvent): void {
    if (event.key !== "ArrowLeft" && event.key !== "ArrowRight") return;
    event.preventDefault();
    event.stopPropagation();
    turn(event.key === "ArrowRight" ? 1 : -1);
    heads[current]!.focus();
  }

  open(0);
  return {
    open,
    turn: () => turn(1),
    update() {
      tabs.forEach(({ parts }, index) => {
        for (const part of parts) part.update();
        show(
          heads[index]!,
          parts.some(({ element }) => !element.hidden),
        );
      });
      if (heads[current]!.hidden) open(0);
    },
    count(index, count, meaning) {
      const badge = badges[index]!;
      show(badge, count > 0);
      write(badge, String(count));
      mark(badge, "aria-label", `${count} ${meaning}`);
      mark(badge, "role", "img");
    },
  };
}
