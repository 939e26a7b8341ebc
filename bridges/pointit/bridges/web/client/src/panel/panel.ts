/** The side panel: controls and health, as two tabs. */

import type { Controls } from "../controls";
import { el, icon, mark, show, write } from "../dom";
import type { Part } from "./part";

export interface Tab {
  name: string;
  icon: string;
  parts: readonly Part[];
}

export interface Panel {
  update(): void;
  /** Show the other tab. */
  turn(): void;
  open(index: number): void;
  /** A number at a tab's name; 0: none. */
  count(index: number, count: number, meaning: string): void;
}

/** Fill `host` with tabs. */
export function makePanel(host: HTMLElement, controls: Controls, tabs: readonly Tab[]): Panel {
  let current = 0;
  const badges = tabs.map(() => el("span", { className: "count", hidden: true }));
  const heads = tabs.map((tab, index) => el("button", {
    type: "button", role: "tab", id: `tab-${index}`, "aria-controls": `page-${index}`, onclick: () => open(index),
    onkeydown: (event) => travel(event as KeyboardEvent),
  }, icon(tab.icon), el("span", { text: tab.name }), badges[index]!));
  const pages = tabs.map((tab, index) => el("div", {
    role: "tabpanel", id: `page-${index}`, "aria-labelledby": `tab-${index}`, className: "page", tabindex: 0,
  }, ...tab.parts.map((part) => part.element)));
  const handle = el("button", { type: "button", className: "handle", "aria-expanded": "true", "aria-label": "Controls", onclick: () => {
    const isLow = host.classList.toggle("low");
    mark(handle, "aria-expanded", String(!isLow));
  } });
  host.append(handle, el("div", { role: "tablist", "aria-label": "Panel", className: "tabs" }, ...heads), ...pages);

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

  function travel(event: KeyboardEvent): void {
    const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!by) return;
    event.preventDefault();
    event.stopPropagation();
    open((current + by + tabs.length) % tabs.length);
    heads[current]!.focus();
  }

  open(0);
  return {
    open,
    turn: () => open((current + 1) % tabs.length),
    update() {
      for (const part of tabs[current]!.parts) part.update();
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
