/** Components within a page whose frame is made by hand: each is a part of the panel. */

import { render, type ComponentChildren } from "preact";
import { el, show } from "../dom";
import type { PanelPart } from "../panel/panel_part";
import { headingId } from "./elements";

/** A titled part with a component in it, drawn anew at each update of the panel. */
export function componentPart(
  title: string,
  isShown: () => boolean,
  content: () => ComponentChildren,
): PanelPart {
  const id = headingId(title);
  const element = el("section", { className: "part", "aria-labelledby": id });
  return {
    element,
    update() {
      show(element, isShown());
      render(
        <>
          <h2 id={id}>{title}</h2>
          {content()}
        </>,
        element,
      );
    },
  };
}

/** A tab's content that is drawn while it is seen, at most once in `everyMs`. */
export function seldomPart(everyMs: number, content: (now: number) => ComponentChildren): PanelPart {
  const element = el("div");
  let drawnAt = -Infinity;
  return {
    element,
    update() {
      const now = performance.now();
      if (!element.offsetParent) {
        drawnAt = -Infinity;
        return;
      }
      if (now - drawnAt < everyMs) return;
      drawnAt = now;
      render(content(now), element);
    },
  };
}
