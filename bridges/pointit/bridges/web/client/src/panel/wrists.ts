/** Wrists within reach of the page's machine, with the words that connect them. */

import type { Controls } from "../controls";
import { el, folded, icon, show, write } from "../dom";
import type { Part } from "./part";

export interface FoundWrist {
  use: string;
  label: string;
}

/** The wrists in a reply, whatever it holds. */
export function foundWrists(reply: Record<string, unknown>): FoundWrist[] {
  const listed: unknown = reply["wrists"];
  if (!Array.isArray(listed)) return [];
  return listed.flatMap((each: unknown) => {
    const { use, label } = (each ?? {}) as Partial<Record<string, unknown>>;
    return typeof use === "string" && typeof label === "string" ? [{ use, label }] : [];
  });
}

/** The command that connects a wrist to another person. */
export function command(wrist: FoundWrist): string {
  return `pointit person add NAME ${wrist.use}`;
}

export function wristsPart(controls: Controls): Part {
  const find = el("button", { type: "button", onclick: () => void search() }, icon("watch"), el("span", { text: "Find wrists" }));
  const state = el("p", { className: "muted", role: "status" });
  const list = el("ul", { className: "wrists" });
  const problems = el("ul", { className: "muted" });
  const element = folded("Wrists", false, find, state, list, problems);

  async function search(): Promise<void> {
    find.disabled = true;
    write(state, "Searching near the machine that serves this page …");
    const reply = await controls.ask({ deed: "find_wrists" }, { isQuiet: true, patienceMs: 15_000 });
    find.disabled = false;
    const wrists = foundWrists(reply ?? {});
    const listed: unknown = reply?.["problems"];
    write(state, !reply ? "" : wrists.length === 0 ? "None found." : "A command connects one, in a terminal on that machine. NAME is the person.");
    list.replaceChildren(...wrists.map((wrist) => el("li", {}, el("span", { text: wrist.label }), el("code", { text: command(wrist) }))));
    problems.replaceChildren(...(Array.isArray(listed) ? listed : []).map((each) => el("li", { text: String(each) })));
  }

  return {
    element,
    update() {
      show(element, controls.mayDo("find_wrists"));
    },
  };
}
