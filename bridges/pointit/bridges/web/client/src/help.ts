/** `?`: help and keyboard shortcuts. */

import { el, icon } from "./dom";
import { glossary } from "./glossary";
import type { Shortcut } from "./keys";
import { keepSettings, type Settings } from "./settings";

export interface Help {
  open(): void;
}

export function makeHelp(shortcuts: () => readonly Shortcut[], settings: Settings): Help {
  const held = document.getElementById("licences"); // of a page without a server
  const rows = el("tbody", {});
  const single = el("input", { type: "checkbox", onchange: () => {
    settings.shortcuts = single.checked;
    keepSettings(settings);
  } });
  const close = el("button", { type: "button", className: "quiet", "aria-label": "Close", onclick: () => dialog.close() }, icon("close"));
  const dialog = el("dialog", { className: "sheet", "aria-labelledby": "help-title" },
    el("header", {}, el("h2", { id: "help-title", text: "Help" }), close),
    el("p", { text: "A sensor on a person's wrist measures where their arm points. Light on the strips shows the target, and dwelling on an object selects it. With the mouse you move the arm yourself." }),
    el("table", { className: "keys" }, el("caption", { className: "unseen", text: "Keys" }),
      el("thead", { className: "unseen" }, el("tr", {}, el("th", { scope: "col", text: "Key" }), el("th", { scope: "col", text: "What it does" }))), rows),
    el("label", { className: "check" }, single, el("span", { text: "Single keys do this (Escape, arrows and ? always do)" })),
    held ? null : glossary(),
    held ? el("details", {}, el("summary", {}, "Licences of this page's components", icon("chevron")), el("pre", { text: held.textContent }))
      : el("p", { className: "muted" }, "Licences of this page's components: ", el("a", { href: "/static/LICENSES.txt", target: "_blank", rel: "noreferrer", text: "LICENSES.txt" })));
  document.body.append(dialog);
  return {
    open() {
      single.checked = settings.shortcuts;
      rows.replaceChildren(...shortcuts().filter((each) => each.isOffered()).map(({ shown, does }) =>
        el("tr", {}, el("th", { scope: "row" }, ...shown.split(" ").map((name) => el("kbd", { text: name }))), el("td", { text: does }))));
      if (!dialog.open) dialog.showModal();
    },
  };
}
