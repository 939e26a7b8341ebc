/** The glossary in `?`: the first table of the documents' own, with what users read in the page, which the build copies to `static/`. */

import { el, icon } from "./dom";

export interface Word {
  word: string;
  meaning: string;
}

/** Rows of the first table in `markdown`, as plain text: links by their text, those in brackets of their own not at all. */
export function wordsOf(markdown: string): Word[] {
  const plain = (cell: string): string =>
    cell
      .replace(/ \(\[[^\]]*\]\([^)]*\)\)/g, "")
      .replace(/\[([^\]]*)\]\([^)]*\)/g, "$1")
      .replaceAll("`", "")
      .trim();
  const rows = (markdown.split("\n\n").find((part) => part.startsWith("|")) ?? "")
    .trim()
    .split("\n")
    .slice(2);
  return rows
    .map((row) => row.split("|"))
    .map(([, word = "", meaning = ""]) => ({ word: plain(word), meaning: plain(meaning) }));
}

/** A part of the help that fetches the words when it is opened first. */
export function glossary(): HTMLDetailsElement {
  const list = el("dl", {});
  const said = el("p", { className: "muted", role: "status" });
  const element = el(
    "details",
    {
      className: "words",
      ontoggle: () => {
        if (element.open && !list.childElementCount) void load();
      },
    },
    el("summary", {}, el("span", { text: "What the words mean" }), icon("chevron")),
    said,
    list,
  );

  async function load(): Promise<void> {
    said.textContent = "Loading …";
    try {
      const answer = await fetch("/static/glossary.md");
      if (!answer.ok) throw new Error(answer.statusText);
      list.replaceChildren(
        ...wordsOf(await answer.text()).flatMap(({ word, meaning }) => [
          el("dt", { text: word }),
          el("dd", { text: meaning }),
        ]),
      );
      said.textContent = "";
    } catch {
      said.textContent =
        "The words could not be loaded. Is PointIt still running? Close this part and open it again.";
    }
  }

  return element;
}
