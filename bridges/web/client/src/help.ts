/** `?`: help and keyboard shortcuts. */

import { el, icon, sheet } from "./dom";
import { glossary } from "./glossary";
import { now, type Shortcut } from "./keys";

export interface Help {
  open(): void;
}

export function makeHelp(
  shortcuts: () => readonly Shortcut[],
  gestures: () => readonly (readonly [string, string])[],
): Help {
  const held = document.getElementById("licences"); // of a page without a server
  const rows = el("tbody", {});
  const dialog = sheet(
    "Help",
    el("p", {
      text: "A sensor on a person's wrist measures where their arm points. Light on the strips shows the target, and dwelling on an object selects it. With the mouse you move the arm yourself.",
    }),
    el(
      "table",
      { className: "keys" },
      el("caption", { className: "unseen", text: "Keys" }),
      el(
        "thead",
        { className: "unseen" },
        el(
          "tr",
          {},
          el("th", { scope: "col", text: "Key" }),
          el("th", { scope: "col", text: "What it does" }),
        ),
      ),
      rows,
    ),
    el("p", { className: "muted", text: "The settings of this page switch single keys off." }),
    held ? null : glossary(),
    held
      ? el(
          "details",
          {},
          el("summary", {}, "Licences of this page's components", icon("chevron")),
          el("pre", { text: held.textContent }),
        )
      : el(
          "p",
          { className: "muted" },
          "Licences of this page's components: ",
          el("a", {
            href: "/static/LICENSES.txt",
            target: "_blank",
            rel: "noreferrer",
            text: "LICENSES.txt",
          }),
        ),
  );
  return {
    open() {
      const row = (names: readonly string[], does: string): HTMLElement =>
        el(
          "tr",
          {},
          el("th", { scope: "row" }, ...names.map((name) => el("kbd", { text: name }))),
          el("td", { text: does }),
        );
      rows.replaceChildren(
        ...gestures().map(([name, does]) => row([name], does)),
        ...shortcuts()
          .filter((each) => each.isOffered())
          .map(({ shown, does }) => row(now(shown).split(" "), now(does))),
      );
      if (!dialog.open) dialog.showModal();
    },
  };
}
