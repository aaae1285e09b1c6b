// Draws a table on a canvas: elements, zones, paths, goals and parts, to scale, as vibgym.rendering.canvas does. It
// knows a scene (what stays, see vibgym.plugins.play.picture) and a view (what is now), lengths in m, y up, and nothing of where
// they come from.

import { placed, wedge } from "./shapes.js";

const PAPER = "#ffffff", INK = "#262c38", GAP = "#ced2d8", FRAME = "#474e5c", REST = "#edeff1";
const ACCENT = "#0a6b66", BAD = "#d02010";
export const MARGIN = 12; // pixels around the table, in which parts that hang over are seen
const HUES = 360, WALL = 7, FAINTEST = 0.03;
const LIFTED = { shadowColor: "rgba(0,0,0,.45)", shadowBlur: 14, shadowOffsetY: 8, globalAlpha: 0.85 };

// Hues of even lightness, as vibgym.rendering.colours has them.
function wheel(lightness, chroma) {
  return Array.from({ length: HUES }, (_, k) => {
    const hue = (360 * k) / HUES - 15, even = lightness + 0.065 * Math.cos(((hue - 150) * Math.PI) / 180);
    return `oklch(${even} ${chroma} ${hue})`;
  });
}

const FULL = wheel(0.78, 0.125), ARROW = wheel(0.36, 0.075);
const hueOf = (c, s) => ((Math.round((Math.atan2(s, c) * HUES) / (2 * Math.PI)) % HUES) + HUES) % HUES;
const mixed = (colour, share, other) => `color-mix(in srgb, ${colour} ${100 * share}%, ${other})`;
export const darker = (tint) => mixed(tint, 0.45, "black");

// Signed bytes from base64: an element's phasor (C, S) in 1/127 of full scale.
export function bytes(text) {
  return Int8Array.from(atob(text), (each) => each.charCodeAt(0));
}

export class Table {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.under = document.createElement("canvas"); // elements and zones: drawn anew when the field is another one
    this.scene = null;
  }

  setScene(scene) {
    this.scene = scene;
    this.wedges = scene.outlines.map(wedge);
    this.width = scene.columns * scene.size;
    this.depth = scene.rows * scene.size;
    this.resize();
  }

  resize() {
    if (!this.scene) return;
    const across = this.canvas.clientWidth || 960, ratio = Math.min(2, window.devicePixelRatio || 1);
    this.scale = (across - 2 * MARGIN) / this.width;
    const high = Math.round(this.depth * this.scale + 2 * MARGIN);
    this.canvas.style.height = `${high}px`;
    for (const canvas of [this.canvas, this.under]) {
      canvas.width = Math.round(across * ratio);
      canvas.height = Math.round(high * ratio);
    }
    this.ratio = ratio;
    this.drawn = null;
  }

  // From m to CSS pixels, and back.
  at([x, y]) {
    return [MARGIN + x * this.scale, MARGIN + (this.depth - y) * this.scale];
  }

  from([u, v]) {
    return [(u - MARGIN) / this.scale, this.depth - (v - MARGIN) / this.scale];
  }

  // view: pose and goal (null: none) of each part, there, field; and, where there are any, fallen; chosen, a part; held, {part: why
  // it cannot be put down, or ""}.
  draw(view) {
    const { context, scene } = this;
    if (this.drawn !== view.field) this.#ground(view.field);
    this.drawn = view.field;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.drawImage(this.under, 0, 0);
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    const each = (list, draw) => (list || []).forEach((one, part) => view.there[part] && one && draw(one, part));
    each(scene.paths, (path, part) => this.#path(path, scene.tints[part][0]));
    if (scene.goalSize) each(view.goal, (goal, part) => (!scene.scored.length || scene.scored[part]) && this.#goal(goal, part, view));
    each(view.pose, (pose, part) => this.#part(pose, part, view));
  }

  #ground(field) {
    const { scene } = this, context = this.under.getContext("2d"), size = scene.size * this.scale;
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    context.fillStyle = PAPER;
    context.fillRect(0, 0, this.under.width, this.under.height);
    const [left, top] = this.at([0, this.depth]), [right, bottom] = this.at([this.width, 0]);
    for (const [grow, colour] of [[3, FRAME], [1, GAP]]) {
      context.fillStyle = colour;
      context.beginPath();
      context.roundRect(left - grow, top - grow, right - left + 2 * grow, bottom - top + 2 * grow, 2 * grow);
      context.fill();
    }
    this.#walls(context, left, top, right, bottom);
    for (let row = 0; row < scene.rows; row++) {
      for (let column = 0; column < scene.columns; column++) {
        const k = 2 * (row * scene.columns + column), c = field[k] / 127, s = field[k + 1] / 127;
        const strength = Math.min(1, Math.hypot(c, s)), hue = hueOf(c, s);
        context.fillStyle = mixed(FULL[hue], strength, REST);
        const [u, v] = this.at([column * scene.size, (row + 1) * scene.size]);
        context.fillRect(u + 0.5, v + 0.5, size - 1, size - 1);
        // An element pushes towards (-S, -C), y up.
        if (strength > FAINTEST) this.#arrow(context, u + size / 2, v + size / 2, Math.atan2(c, -s), strength, size, ARROW[hue]);
      }
    }
    scene.zones.forEach((zone) => this.#zone(context, zone));
  }

  #arrow(context, x, y, direction, strength, size, colour) {
    const length = 0.72 * size * strength, shaft = Math.min(0.05 * size, 0.11 * length);
    const head = Math.min(4.4 * shaft, 0.7 * length), across = 2.7 * shaft;
    context.save();
    context.translate(x, y);
    context.rotate(direction);
    context.translate(-0.5 * length, 0);
    context.fillStyle = colour;
    this.#fill(context, [[0, shaft], [length - head, shaft], [length - head, across], [length, 0],
      [length - head, -across], [length - head, -shaft], [0, -shaft]]);
    context.restore();
  }

  #walls(context, left, top, right, bottom) {
    const deep = bottom - top, wide = right - left, bars = {
      left: [left - WALL, top - WALL, WALL, deep + 2 * WALL], right: [right, top - WALL, WALL, deep + 2 * WALL],
      top: [left - WALL, top - WALL, wide + 2 * WALL, WALL], bottom: [left - WALL, bottom, wide + 2 * WALL, WALL],
    };
    context.fillStyle = INK;
    this.scene.walls.forEach((wall) => context.fillRect(...bars[wall]));
  }

  #zone(context, { box, tint: [colour, mark], label }) {
    const [left, top] = this.at([box[0], box[3]]), [right, bottom] = this.at([box[2], box[1]]);
    context.save();
    context.globalAlpha = mark === INK ? 0.47 : 0.2;
    context.fillStyle = colour;
    context.fillRect(left, top, right - left, bottom - top);
    context.globalAlpha = 1;
    context.setLineDash([6, 6]);
    for (const [width, tone] of [[3.8, mark], [2.2, colour]]) {
      context.lineWidth = width;
      context.strokeStyle = tone;
      context.strokeRect(left + 2, top + 2, right - left - 4, bottom - top - 4);
    }
    context.font = "12px system-ui, sans-serif";
    const wide = context.measureText(label).width + 14;
    if (label && wide < right - left) {
      context.fillStyle = colour;
      context.fillRect(left, top, wide, 19);
      context.fillStyle = mark;
      context.fillText(label, left + 7, top + 14);
    }
    context.restore();
  }

  #outline(context, points, closed = true) {
    context.beginPath();
    points.forEach(([u, v]) => context.lineTo(u, v));
    if (closed) context.closePath();
  }

  #fill(context, points) {
    this.#outline(context, points);
    context.fill();
  }

  #stroke(points, colour, width, alpha = 1, dashes = [], closed = false) {
    const { context } = this;
    context.save();
    Object.assign(context, { strokeStyle: colour, lineWidth: width, globalAlpha: alpha, lineJoin: "round", lineCap: "round" });
    context.setLineDash(dashes);
    this.#outline(context, points, closed);
    context.stroke();
    context.restore();
  }

  #path(path, tint) {
    const points = path.map((each) => this.at(each));
    if (points.length < 2) return;
    this.#stroke(points, PAPER, 4, 0.6);
    this.#stroke(points, tint, 1.6, 0.67);
  }

  #corners(outline, pose) {
    return placed(outline, pose).map((each) => this.at(each));
  }

  // The mark that shows a heading, within the outline.
  #marked(corners, part, pose, colour, alpha) {
    const { context } = this;
    context.save();
    this.#outline(context, corners);
    context.clip();
    Object.assign(context, { fillStyle: colour, globalAlpha: alpha });
    this.#fill(context, this.#corners(this.wedges[part], pose));
    context.restore();
  }

  #goal(goal, part, view) {
    const { context, scene } = this, [x, y] = this.at(goal), whole = scene.goalSize === 3;
    const corners = whole ? this.#corners(scene.outlines[part], goal) : [];
    if (whole) {
      context.save();
      Object.assign(context, { fillStyle: PAPER, globalAlpha: 0.63 });
      this.#fill(context, corners);
      context.restore();
      this.#marked(corners, part, goal, INK, 0.59);
    }
    const ways = whole ? [] : [[1, 0], [0, 1], [-1, 0], [0, -1]];
    for (const [width, colour, alpha] of [[4.5, PAPER, 0.86], [view.chosen === part ? 3 : 1.9, INK, 1]]) {
      if (whole) this.#stroke(corners, colour, width, alpha, [4.5, 5.5], true);
      ways.forEach(([u, v]) => this.#stroke([4, 12].map((r) => [x + r * u, y + r * v]), colour, width, alpha));
      if (!scene.tolerance) continue;
      Object.assign(context, { strokeStyle: colour, lineWidth: 0.7 * width });
      context.beginPath();
      context.arc(x, y, scene.tolerance * this.scale, 0, 2 * Math.PI);
      context.stroke();
    }
  }

  #part(pose, part, view) {
    const { context, scene } = this, [colour, mark] = scene.tints[part], why = (view.held || {})[part];
    const corners = this.#corners(scene.outlines[part], pose), lifted = why !== undefined;
    context.save();
    if (!lifted) {
      Object.assign(context, { fillStyle: INK, globalAlpha: 0.24 });
      this.#fill(context, corners.map(([u, v]) => [u + 2, v + 2]));
    }
    Object.assign(context, { fillStyle: colour, globalAlpha: view.fallen && view.fallen[part] ? 0.35 : 0.94 }, lifted ? LIFTED : {});
    this.#fill(context, corners);
    context.restore();
    const chosen = view.chosen === part, edge = lifted && why ? BAD : chosen ? ACCENT : darker(colour);
    this.#stroke(corners, edge, lifted || chosen ? 3 : 1.6, 0.9, [], true);
    this.#marked(corners, part, pose, mark, 1);
  }
}
