/** The message log, newest first, with a filter. */

import type { Controls } from "../controls";
import { el, icon, renew, section } from "../dom";
import { time } from "../format";
import { matching } from "../site/log";
import type { PanelPart } from "./panel_part";

const MOST_SHOWN = 100;
const SIGNS = { info: "info", warning: "warning", error: "warning" } as const;

export function messagesPart(controls: Controls): PanelPart {
  const { site } = controls;
  const filter = el("input", {
    type: "search",
    placeholder: "Filter",
    "aria-label": "Filter the messages",
    oninput: () => self.update(),
  });
  const list = el("ol", { className: "log", tabindex: 0, "aria-label": "Messages, newest first" });
  const element = section("Messages", filter, list);
  const self: PanelPart = {
    element,
    update() {
      if (!element.offsetParent) return;
      renew(list, `${site.logged} ${filter.value}`, () => {
        const lines = matching(site.log, filter.value, MOST_SHOWN);
        return lines.length
          ? lines.map(({ at, severity, who, text }) =>
              el(
                "li",
                { "data-severity": severity },
                icon(SIGNS[severity]),
                el(
                  "span",
                  {},
                  el("time", { text: time(at) }),
                  " ",
                  who ? el("b", { text: who }) : null,
                  " ",
                  text,
                  severity === "info" ? null : el("span", { className: "unseen", text: ` (${severity})` }),
                ),
              ),
            )
          : [
              el("li", {
                className: "muted",
                text: filter.value ? "No message fits." : "Nothing has happened yet.",
              }),
            ];
      });
    },
  };
  return self;
}
