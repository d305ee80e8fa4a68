"use strict";

// --- poses: x y z and a unit quaternion x y z w, as in motions --------------------------

const rotate = ([x, y, z, w], [a, b, c]) => {
  const [u, v, t] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * u + y * t - z * v, b + w * v + z * u - x * t, c + w * t + x * v - y * u];
};
const multiply = ([a, b, c, d], [x, y, z, w]) => [
  d * x + a * w + b * z - c * y,
  d * y - a * z + b * w + c * x,
  d * z + a * y - b * x + c * w,
  d * w - a * x - b * y - c * z,
];
const place = (pose, point) => {
  const [x, y, z] = rotate(pose.slice(3), point);
  return [x + pose[0], y + pose[1], z + pose[2]];
};
const compose = (a, b) => [...place(a, b), ...multiply(a.slice(3), b.slice(3))];
const inside = (pose, point) => {
  const [x, y, z, w] = pose.slice(3);
  return rotate([-x, -y, -z, w], point.map((value, n) => value - pose[n]));
};
const BASE = ["x", "y", "z", "roll", "pitch", "yaw"];
const IDENTITY = [0, 0, 0, 0, 0, 0, 1];

const decode = (text, Kind) => {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Kind(bytes.buffer);
};

/** The last row whose time is not later, from 0 to length - 2. */
const rowBefore = (times, time) => {
  let [low, high] = [0, Math.max(times.length - 1, 1)];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle;
    else high = middle;
  }
  return low;
};

const nearest = (times, time) => {
  const row = rowBefore(times, time);
  return time - times[row] > times[row + 1] - time ? row + 1 : row;
};

/** Intervals that overlap as one. */
const joined = (intervals) => {
  const found = [];
  for (const [first, last] of [...intervals].sort((a, b) => a[0] - b[0])) {
    const before = found[found.length - 1];
    if (before && first <= before[1]) before[1] = Math.max(before[1], last);
    else found.push([first, last]);
  }
  return found;
};

// --- a motion ---------------------------------------------------------------------------

class Motion {
  constructor(robot, content) {
    Object.assign(this, content);
    this.robot = robot;
    this.times = decode(content.times, Float64Array);
    this.positions = decode(content.positions, Float32Array);
    const optional = (text) => text && decode(text, Float32Array);
    this.velocities = optional(content.velocities);
    this.roots = optional(content.roots);
    this.checked = content.checked && decode(content.checked, Float64Array);
    if (this.forces) this.forces = { arrows: optional(content.forces.arrows), missing: optional(content.forces.missing) };
    if (content.before) this.before = new Motion(robot, content.before);
    this.begin = this.times[0];
    this.end = this.times[this.times.length - 1];
    this.isSingle = this.times.length === 1;
    this.step = this.isSingle ? Infinity : (this.end - this.begin) / (this.times.length - 1);
    const rows = Object.fromEntries(robot.links.map((link, row) => [link.name, row]));
    for (const cause of this.causes) {
      for (const finding of cause.findings) {
        const poses = this.poses(finding.time);
        finding.links = finding.links.map((name) => rows[name]);
        finding.red = finding.red.map((name) => rows[name]);
        finding.points = finding.points.map((point, n) =>
          finding.links[n] === undefined ? point : inside(poses[finding.links[n]], point));
      }
      cause.failed = cause.findings.some((finding) => finding.failed);
      cause.intervals = joined(cause.findings.flatMap((finding) => finding.intervals));
    }
  }

  /** The rows before and after a time, the fraction between them and their distance. */
  between(time) {
    const row = rowBefore(this.times, time);
    const next = Math.min(row + 1, this.times.length - 1);
    const gap = this.times[next] - this.times[row] || 1;
    return [row, next, Math.min(Math.max((time - this.times[row]) / gap, 0), 1), gap];
  }

  /** Position and velocity of a joint of the motion: linear, or cubic with velocities. */
  joint(column, time) {
    const [row, next, s, gap] = this.between(time);
    const n = this.joints.length;
    const [p, q] = [this.positions[row * n + column], this.positions[next * n + column]];
    if (!this.velocities) return [p + s * (q - p), (q - p) / gap];
    const u = gap * this.velocities[row * n + column];
    const v = gap * this.velocities[next * n + column];
    const [square, cube] = [3 * (q - p) - 2 * u - v, u + v - 2 * (q - p)];
    return [p + s * (u + s * (square + s * cube)), (u + s * (2 * square + 3 * s * cube)) / gap];
  }

  root(time) {
    if (!this.roots) return IDENTITY;
    const [row, next, s] = this.between(time);
    const [a, b] = [row, next].map((n) => [...this.roots.slice(7 * n, 7 * n + 7)]);
    const mix = (x, y, r) => x.map((value, n) => value + r * (y[n] - value));
    let cos = a.slice(3).reduce((sum, value, n) => sum + value * b[n + 3], 0);
    const sign = cos < 0 ? -1 : 1;
    cos = Math.min(Math.abs(cos), 1);
    const angle = Math.acos(cos);
    const [from, to] = angle < 1e-4 ? [1 - s, s]
      : [Math.sin((1 - s) * angle) / Math.sin(angle), Math.sin(s * angle) / Math.sin(angle)];
    const turn = a.slice(3).map((value, n) => from * value + sign * to * b[n + 3]);
    const length = Math.hypot(...turn);
    return [...mix(a.slice(0, 3), b, s), ...turn.map((value) => value / length)];
  }

  /** Poses of objects, given those of the links. */
  objects(time, links) {
    return this.holds.map((some) => {
      const { link, pose } = some.filter(({ begin }) => begin <= time).pop() || some[0];
      return link === null ? pose : compose(links[link], pose);
    });
  }

  /** Poses of all links and then objects, or of a set of rows of links with all above. */
  poses(time, only = null) {
    const positions = new Array(this.robot.joints.length).fill(0);
    this.joints.forEach((joint, column) => { positions[joint] = this.joint(column, time)[0]; });
    const root = this.root(time);
    const poses = [];
    for (const [row, link] of this.robot.links.entries()) {
      if (only && !only.has(row)) {
        poses.push(null);
        continue;
      }
      if (link.parent === undefined) {
        poses.push(root);
        continue;
      }
      let pose = link.rest;
      if (link.joint !== null) {
        const { axis, origin, slides } = this.robot.joints[link.joint];
        const position = positions[link.joint];
        if (slides) {
          pose = compose(pose, [...axis.map((part) => part * position), 0, 0, 0, 1]);
        } else {
          const sin = Math.sin(position / 2);
          const turn = [...axis.map((part) => part * sin), Math.cos(position / 2)];
          const moved = rotate(turn, origin);
          pose = compose(pose, [...origin.map((part, n) => part - moved[n]), ...turn]);
        }
      }
      poses.push(compose(poses[link.parent], pose));
    }
    return only ? poses : [...poses, ...this.objects(time, poses)];
  }

  /** Coordinates of the root over all samples: x, y, z, roll, pitch, yaw without jumps. */
  coordinate(name) {
    const number = BASE.indexOf(name);
    let before = null;
    return Float32Array.from(this.times, (_, row) => {
      const [px, py, pz, x, y, z, w] = this.roots.slice(7 * row, 7 * row + 7);
      if (number < 3) return [px, py, pz][number];
      let angle = [
        Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        Math.asin(Math.min(Math.max(2 * (w * y - z * x), -1), 1)),
        Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
      ][number - 3];
      if (before !== null) angle += 2 * Math.PI * Math.round((before - angle) / (2 * Math.PI));
      before = angle;
      return angle;
    });
  }

  /** Speed of the origin of a link over all samples: differences of its places. */
  speed(link) {
    const chain = new Set();
    for (let row = link; row !== undefined; row = this.robot.links[row].parent) chain.add(row);
    const places = Array.from(this.times, (time) => this.poses(time, chain)[link].slice(0, 3));
    return Float32Array.from(this.times, (_, row) => {
      const [first, last] = [Math.max(row - 1, 0), Math.min(row + 1, places.length - 1)];
      const [a, b] = [places[first], places[last]];
      return Math.hypot(b[0] - a[0], b[1] - a[1], b[2] - a[2]) / (this.times[last] - this.times[first]);
    });
  }

  /** Contact forces at a time: starts and vectors of arrows; the last one is missing, with a text. */
  arrows(time) {
    if (!this.forces) return [];
    const { arrows, missing } = this.forces;
    const row = nearest(this.checked, time);
    const size = arrows.length / this.checked.length;
    const [force, moment] = missing.slice(2 * row, 2 * row + 2);
    const text = Number.isNaN(force) ? "" : `${force.toFixed(0)} N and ${moment.toFixed(1)} N m are missing`;
    return Array.from({ length: size / 6 }, (_, n) => {
      const numbers = [...arrows.slice(row * size + 6 * n, row * size + 6 * n + 6)];
      const isMissing = 6 * (n + 1) === size;
      return { start: numbers.slice(0, 3), vector: numbers.slice(3), isMissing, text: isMissing ? text : "" };
    });
  }

  /** Whether a finding or cause is there at a time. */
  isAt(found, time) {
    const room = 0.5 * this.step + 1e-6;
    return Math.abs(time - found.time) < room || found.intervals.some(
      ([first, last]) => first - room < time && time < last + room);
  }
}
