/** How unsure a place on the floor is. */

/** An ellipse about a place; half axes in metres, `angle` (rad): azimuth of the longer one. */
export interface Ellipse {
  major: number;
  minor: number;
  angle: number;
}

/** The `sigmas`-sigma ellipse of a pose's covariance (row by row, of x, y, yaw). */
export function ellipseOf(covariance: readonly number[], sigmas = 2): Ellipse {
  const xx = covariance[0] ?? 0;
  const yy = covariance[4] ?? 0;
  const xy = ((covariance[1] ?? 0) + (covariance[3] ?? 0)) / 2;
  const middle = (xx + yy) / 2;
  const spread = Math.hypot((xx - yy) / 2, xy);
  return {
    major: sigmas * Math.sqrt(Math.max(middle + spread, 0)),
    minor: sigmas * Math.sqrt(Math.max(middle - spread, 0)),
    angle: Math.atan2(2 * xy, xx - yy) / 2,
  };
}
