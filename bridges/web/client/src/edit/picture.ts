/** A floor plan under the map: a picture that stays in this browser. Its scale is two clicks and a length. */

/** In {W}: its left and upper edge, and its size, m. */
export interface Picture {
  source: string;
  left: number;
  top: number;
  width: number;
  height: number;
}

export type Place = readonly [number, number];

/** The picture so that `a` and `b`, places under which it has two things, are `metres` apart; `a` stays. */
export function scaled(picture: Picture, a: Place, b: Place, metres: number): Picture {
  const by = metres / Math.hypot(b[0] - a[0], b[1] - a[1]);
  return {
    ...picture,
    left: a[0] + (picture.left - a[0]) * by,
    top: a[1] + (picture.top - a[1]) * by,
    width: picture.width * by,
    height: picture.height * by,
  };
}

/** The picture with another width, its upper left corner where it is. */
export function widened(picture: Picture, width: number): Picture {
  return { ...picture, width, height: (picture.height * width) / picture.width };
}

/** Larger pictures are made smaller: browsers keep some megabytes, px. */
const MOST_PX = 1800;
const nameOf = (path: string): string => `pointit.picture.${path}`;

/** The picture that is kept for the map at `path`, or null. */
export function keptPicture(path: string): Picture | null {
  try {
    const found = JSON.parse(localStorage.getItem(nameOf(path)) ?? "null") as Picture | null;
    return found &&
      /^data:image\//.test(found.source) &&
      [found.left, found.top, found.width, found.height].every(Number.isFinite)
      ? found
      : null;
  } catch {
    return null; // storage may be forbidden, or hold what is not ours
  }
}

/** Keep it, or forget it if it is null; false if this browser has no room. */
export function keepPicture(path: string, picture: Picture | null): boolean {
  try {
    if (picture) localStorage.setItem(nameOf(path), JSON.stringify(picture));
    else localStorage.removeItem(nameOf(path));
    return true;
  } catch {
    return false;
  }
}

/** The picture in a file, as wide as `width` m with its upper left corner at (left, top); rejects what is none. */
export async function pictureOf(file: File, left: number, top: number, width: number): Promise<Picture> {
  const bitmap = await createImageBitmap(file);
  const by = Math.min(1, MOST_PX / Math.max(bitmap.width, bitmap.height));
  const canvas = document.createElement("canvas");
  const pen = canvas.getContext("2d")!;
  [canvas.width, canvas.height] = [
    Math.max(1, Math.round(bitmap.width * by)),
    Math.max(1, Math.round(bitmap.height * by)),
  ];
  pen.fillStyle = "#ffffff"; // what is transparent would be black
  pen.fillRect(0, 0, canvas.width, canvas.height);
  pen.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
  return {
    source: canvas.toDataURL("image/jpeg", 0.8),
    left,
    top,
    width,
    height: (width * canvas.height) / canvas.width,
  };
}
