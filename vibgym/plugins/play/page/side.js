// The table from the side, heights magnified, as vibgym.rendering.side has it: plates under parts, and the bottoms of parts that may tilt.

import { MARGIN, darker } from "./table.js";

const MAGNIFIED = 20, GROUND = 84, GAP = "#ced2d8", INK = "#262c38";

// plates: [from, to, height] m; bottoms: of each part [[along, height], ...] m, or null.
export function drawSide(canvas, scene, { plates = [], bottoms = [], there }) {
  const ratio = Math.min(2, window.devicePixelRatio || 1), wide = canvas.clientWidth, high = canvas.clientHeight;
  if (canvas.width !== Math.round(wide * ratio)) canvas.width = Math.round(wide * ratio);
  if (canvas.height !== Math.round(high * ratio)) canvas.height = Math.round(high * ratio);
  const context = canvas.getContext("2d"), length = scene.columns * scene.size, scale = (wide - 2 * MARGIN) / length;
  const at = (x, z) => [MARGIN + scale * x, GROUND - MAGNIFIED * scale * z];
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, wide, high);
  context.fillStyle = INK;
  context.font = "12px system-ui, sans-serif";
  context.fillText(`Side view, heights magnified ${MAGNIFIED} times`, MARGIN, 16);
  context.strokeStyle = context.fillStyle = GAP;
  context.beginPath();
  context.moveTo(...at(0, 0));
  context.lineTo(...at(length, 0));
  context.stroke();
  for (const [from, to, height] of plates) {
    const [begin, top] = at(from, height), [end] = at(to, height);
    context.fillRect(begin + 1, top, end - begin - 2, high - 4 - top);
  }
  bottoms.forEach((bottom, part) => {
    if (!bottom || !there[part]) return;
    const tint = scene.tints[part][0];
    context.beginPath();
    bottom.forEach(([x, z]) => context.lineTo(...at(x, z)));
    context.closePath();
    Object.assign(context, { fillStyle: tint, strokeStyle: darker(tint), lineWidth: 3 });
    context.fill();
    context.stroke();
  });
}
