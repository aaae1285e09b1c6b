// Plane geometry of outlines: [x, y] in m, y up.

export function placed(outline, [x, y, heading]) {
  const c = Math.cos(heading), s = Math.sin(heading);
  return outline.map(([u, v]) => [x + c * u - s * v, y + s * u + c * v]);
}

export function inside(corners, [x, y]) {
  let within = false;
  for (let i = 0, j = corners.length - 1; i < corners.length; j = i++) {
    const [xi, yi] = corners[i], [xj, yj] = corners[j];
    if (yi > y !== yj > y && x < ((xj - xi) * (y - yi)) / (yj - yi) + xi) within = !within;
  }
  return within;
}

// Heading mark of a part, in its frame: a wedge that points ahead.
export function wedge(outline) {
  const reach = Math.max(...outline.map(([u]) => u));
  const half = 0.2 * Math.max(...outline.flat().map(Math.abs));
  return [[0.84 * reach, 0], [0.2 * reach, half], [0.2 * reach, -half]];
}
