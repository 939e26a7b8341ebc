/** Parts of the panel: each has a condition under which it is shown, and a component that draws it. */

import type { ComponentChildren } from "preact";
import { useRef } from "preact/hooks";
import { headingId } from "./elements";

export interface PanelPart {
  /** Whether it has something to show. A hidden part keeps what a person has begun in it. */
  isShown(): boolean;
  draw(): ComponentChildren;
  /** Follow the site, also while another tab is open. */
  follow?(): void;
}

/** A part with a heading. */
export function titledPart(
  title: string | (() => string),
  isShown: () => boolean,
  content: () => ComponentChildren,
): PanelPart {
  return {
    isShown,
    draw() {
      const text = typeof title === "string" ? title : title();
      return (
        <section class="part" aria-labelledby={headingId(text)} hidden={!isShown()}>
          <h2 id={headingId(text)}>{text}</h2>
          {content()}
        </section>
      );
    },
  };
}

/** A part whose name is read out only. */
export function namedPart(
  name: string,
  isShown: () => boolean,
  content: () => ComponentChildren,
  state: () => string | undefined = () => undefined,
): PanelPart {
  return {
    isShown,
    draw: () => (
      <section class="part" aria-label={name} data-state={state()} hidden={!isShown()}>
        {content()}
      </section>
    ),
  };
}

interface SeldomProps {
  /** It is drawn anew only while this holds. */
  isSeen?: boolean;
  everyMs?: number;
  content(nowMs: number): ComponentChildren;
}

/** Content that is drawn anew while it is seen, at most once in `everyMs`. */
export function Seldom({ isSeen = true, everyMs = 0, content }: SeldomProps) {
  const drawn = useRef({ atMs: -Infinity, content: null as ComponentChildren }).current;
  const nowMs = performance.now();
  if (isSeen && nowMs - drawn.atMs >= everyMs) {
    drawn.atMs = nowMs;
    drawn.content = content(nowMs);
  }
  // The same content as before is not compared anew
  return <>{drawn.content}</>;
}
