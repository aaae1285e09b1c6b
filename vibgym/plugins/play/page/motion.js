// Between two steps of the world: poses are interpolated from the displayed to the last received, over the time of a step.

const mixed = (a, b, share) => a.map((each, k) => each + share * (b[k] - each));

export class Motion {
  constructor() {
    this.frame = null;
  }

  // frame: as it came, with pose and goal in m and rad; lasts: ms to the next one.
  take(frame, lasts, now) {
    const before = this.frame;
    const goesOn = before && before.jump === frame.jump && before.pose.length === frame.pose.length && frame.running;
    this.from = goesOn ? this.poses(now) : frame.pose;
    this.fromGoal = goesOn && frame.goal && before.goal ? this.goals(now) : frame.goal;
    this.frame = frame;
    this.began = now;
    this.lasts = Math.max(1, lasts);
  }

  #share(now) {
    return Math.min(1, (now - this.began) / this.lasts);
  }

  poses(now) {
    const share = this.#share(now), { pose, held } = this.frame;
    // A part that was elsewhere a moment ago (it arrived, or was put down) does not fly there.
    return pose.map((each, k) => {
      const from = this.from[k], far = Math.hypot(each[0] - from[0], each[1] - from[1]) > 0.05;
      return far || held[k] !== undefined ? each : mixed(from, each, share);
    });
  }

  goals(now) {
    const share = this.#share(now), { goal } = this.frame;
    return goal && goal.map((each, k) => {
      const from = this.fromGoal[k];
      return !from || Math.hypot(each[0] - from[0], each[1] - from[1]) > 0.05 ? each : mixed(from, each, share);
    });
  }
}
