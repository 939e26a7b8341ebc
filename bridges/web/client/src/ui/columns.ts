/** Options of a choice, and the columns in which they stand. */

export interface Option {
  value: string;
  label: string;
  icon?: string;
  /** CSS colour of a swatch beside the label. */
  swatch?: string;
}

/** Width of an icon or a swatch, in characters of a label. */
const SYMBOL_CHARACTERS = 3;
/** Characters of a label that four columns have room for, three, or two. */
const ROOM = [
  { characters: 6, columns: 4 },
  { characters: 10, columns: 3 },
  { characters: 17, columns: 2 },
] as const;

/** Number of columns with which the rows are as even as can be: two and two rather than three and one. */
export function columnsOf(options: readonly Option[]): number {
  const longest = Math.max(...options.map(charactersOf));
  const most = ROOM.find(({ characters }) => longest <= characters)?.columns ?? 1;
  const rows = Math.ceil(options.length / most);
  return Math.ceil(options.length / rows) || 1;
}

function charactersOf({ label, icon, swatch }: Option): number {
  return icon || swatch ? label.length + SYMBOL_CHARACTERS : label.length;
}
