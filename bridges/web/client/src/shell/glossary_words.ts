/** Words of the glossary in `?`: the first table of the documents' own, with what users read in the page, which the build copies to `static/`. */

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
