// Takes parts and goals: by mouse, finger or keys. What is in the hand is drawn where the hand is, at once; the server hears of it.

import { inside, placed } from "./shapes.js";

const TURN = Math.PI / 36, MOVE = 0.005; // of a key: 5 degrees, 5 mm

export class Hand {
  constructor(table, send) {
    this.table = table;
    this.send = send;
    this.held = null; // {what: "part" | "goal", part, pose, grip, down}
    this.chosen = null;
  }

  // What the pointer is over: a part, else a goal; with `goals` the other way round.
  #under(point, view, goals) {
    const { scene } = this.table, over = (poses) => {
      for (let part = poses.length - 1; part >= 0; part--) {
        if (view.there[part] && inside(placed(scene.outlines[part], poses[part]), point)) return part;
      }
      return null;
    };
    const part = over(view.pose), goal = scene.aims && view.goal ? over(view.goal) : null;
    if (goal !== null && (goals || part === null) && (!scene.scored.length || scene.scored[goal])) return ["goal", goal];
    return part === null ? null : ["part", part];
  }

  down(point, view, goals) {
    if (this.held) return; // a part for which there was no room: it is put down where the button comes up
    const found = this.#under(point, view, goals);
    if (!found) return;
    this.#take(found[0], found[1], view, point);
  }

  #take(what, part, view, point) {
    const pose = [...(what === "part" ? view.pose : view.goal)[part]];
    this.held = { what, part, pose, grip: [pose[0] - point[0], pose[1] - point[1]], begin: true };
    this.chosen = part;
    if (what === "part" && (view.held || {})[part] === undefined) this.send({ do: "lift", part });
  }

  move(point) {
    if (!this.held) return;
    const { pose, grip } = this.held;
    [pose[0], pose[1]] = [point[0] + grip[0], point[1] + grip[1]];
    this.#report();
  }

  turn(angle) {
    if (!this.held) return;
    this.held.pose[2] += angle;
    this.#report();
  }

  #report() {
    const { what, part, pose, begin } = this.held;
    if (what === "part") this.send({ do: "carry", part, pose });
    else this.send({ do: "aim", part, pose: this.#within(pose), begin });
    this.held.begin = false;
  }

  #within([x, y, heading]) {
    const { width, depth } = this.table;
    return [Math.min(width, Math.max(0, x)), Math.min(depth, Math.max(0, y)), heading];
  }

  up() {
    if (!this.held) return;
    const { what, part, pose } = this.held;
    this.held = null;
    if (what === "part") this.send({ do: "place", part, pose });
  }

  // A part that the server still has in the hand (no room, or the page was loaded anew) is taken again by the next press.
  key(event, view) {
    const step = { ArrowLeft: [-MOVE, 0], ArrowRight: [MOVE, 0], ArrowUp: [0, MOVE], ArrowDown: [0, -MOVE] }[event.key];
    const turn = { q: TURN, e: -TURN }[event.key.toLowerCase()];
    if (event.key.toLowerCase() === "n") {
      this.chosen = this.#next(view);
    } else if (event.key.toLowerCase() === "g" && this.chosen !== null && !this.held && view.goal && this.table.scene.aims) {
      this.#take("goal", this.chosen, view, view.goal[this.chosen]);
    } else if (event.key === "Enter") {
      if (this.held) this.up();
      else if (this.chosen !== null) this.#take("part", this.chosen, view, view.pose[this.chosen]);
    } else if (step && this.held) {
      const [x, y] = this.held.pose;
      this.held.grip = [0, 0];
      this.move([x + step[0], y + step[1]]);
    } else if (turn && this.held) {
      this.turn(turn);
    } else {
      return false;
    }
    return true;
  }

  #next(view) {
    const count = view.pose.length;
    for (let k = 1; k <= count; k++) {
      const part = ((this.chosen ?? -1) + k) % count;
      if (view.there[part]) return part;
    }
    return null;
  }

  // The view with what is in the hand where the hand is.
  over(view) {
    const result = { ...view, chosen: this.chosen };
    if (!this.held) return result;
    const { what, part, pose } = this.held, name = what === "part" ? "pose" : "goal";
    result[name] = view[name].map((each, k) => (k === part ? pose : each));
    if (what === "part") result.held = { ...view.held, [part]: (view.held || {})[part] || "" };
    return result;
  }
}
