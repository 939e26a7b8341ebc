/** Ids of elements that name or describe others. */

import { useState } from "preact/hooks";

let last = 0;

/**
 * An id that no other element of the page has. `useId` of the library counts anew in each part that is drawn for
 * itself, and at each drawing of one. The elements made by hand have ids as `slider-1`.
 */
export function useOwnId(name: string): string {
  const [id] = useState(() => `own-${name}-${++last}`);
  return id;
}
