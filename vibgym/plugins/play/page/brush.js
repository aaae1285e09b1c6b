// Paints elements: the stroke's direction is the direction of the push, the slider its strength.

const SETTLED = 300; // ms after which what was painted is in the frames that come

export class Brush {
  constructor(table, send) {
    this.table = table;
    this.send = send;
    this.share = 1;
    this.width = 2;
    this.erase = false;
    this.last = null;
    this.fresh = new Map(); // element -> [C, S, until], shown before the server has it
  }

  down(point) {
    this.last = point;
    this.begin = true;
    if (this.erase) this.#lay(point, null);
  }

  move(point) {
    if (!this.last) return;
    const [dx, dy] = [point[0] - this.last[0], point[1] - this.last[1]], length = Math.hypot(dx, dy);
    if (this.erase) this.#lay(point, null);
    else if (length > 0.25 * this.table.scene.size) {
      // An element pushes towards (-S, -C).
      this.#lay(point, [(-dy / length) * this.share, (-dx / length) * this.share]);
    } else return;
    this.last = point;
  }

  up() {
    this.last = null;
  }

  #lay(point, phasor) {
    const { rows, columns, size } = this.table.scene, half = this.width / 2, elements = [];
    const first = [Math.round(point[1] / size - half), Math.round(point[0] / size - half)];
    for (let i = 0; i < this.width; i++) {
      for (let j = 0; j < this.width; j++) {
        const row = first[0] + i, column = first[1] + j;
        if (row >= 0 && column >= 0 && row < rows && column < columns) elements.push([row, column]);
      }
    }
    if (!elements.length) return;
    this.send({ do: "paint", elements, phasor, begin: this.begin });
    this.begin = false;
    const until = performance.now() + SETTLED;
    elements.forEach(([row, column]) => this.fresh.set(row * columns + column, [...(phasor || [0, 0]), until]));
  }

  // The field with what was painted a moment ago.
  over(field, now) {
    if (!this.fresh.size) return field;
    const result = field.slice();
    for (const [k, [c, s, until]] of this.fresh) {
      if (now > until) this.fresh.delete(k);
      else [result[2 * k], result[2 * k + 1]] = [Math.round(127 * c), Math.round(127 * s)];
    }
    return result;
  }
}
