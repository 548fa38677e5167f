// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
// The functions documented at https://cyberbotics.com/doc/reference/javascript-procedural-proto. A rotation is
// {x, y, z, a}, a quaternion {w, x, y, z}, a matrix has the keys 0 to 8 in row-major order. Random numbers are Webots'
// sequence, also in Math.random, and the clock is constant, so that loading a world is deterministic.
"use strict";
const $modules = (() => {
  const has = (keys, size) => (v) => {
    const found = Object.keys(Object(v));
    return found.length === size && keys.every((key) => typeof v[key] === "number");
  };
  const isVector2 = has(["x", "y"], 2), isVector3 = has(["x", "y", "z"], 3);
  const copy = (v) => {
    if (Array.isArray(v)) return v.map(copy);
    if (v === null || typeof v !== "object") return v;
    return Object.fromEntries(Object.entries(v).map(([key, item]) => [key, copy(item)]));
  };
  const wbutility = {
    assert() {}, error() {}, info() {}, deepCopy: copy,
    degreesToRadians: (angle) => angle * Math.PI / 180,
    radiansToDegrees: (angle) => angle * 180 / Math.PI,
    isScalar: (s) => typeof s === "number",
    isVector2, isVector3,
    isAxisAngle: has(["x", "y", "z", "a"], 4),
    isQuaternion: has(["w", "x", "y", "z"], 4),
    isMatrix3: has([0, 1, 2, 3, 4, 5, 6, 7, 8], 9),
    isArrayOfPoints: (points, size) => Array.isArray(points) && points.every(size === 2 ? isVector2 : isVector3),
  };
  const vectors = (keys) => {
    const each = (value) => Object.fromEntries(keys.map((key) => [key, value(key)]));
    const dot = (a, b) => keys.reduce((sum, key) => sum + a[key] * b[key], 0);
    const norm = (v) => Math.sqrt(dot(v, v));
    const minus = (a, b) => each((key) => a[key] - b[key]);
    return {
      dot, norm, minus,
      equal: (a, b) => keys.every((key) => a[key] === b[key]),
      add: (a, b) => each((key) => a[key] + b[key]),
      multiply: (v, s) => each((key) => s * v[key]),
      distance: (a, b) => norm(minus(a, b)),
      normalize: (v) => { const length = norm(v); return length === 0 ? null : each((key) => v[key] / length); },
    };
  };
  const wbvector2 = vectors(["x", "y"]), wbvector3 = vectors(["x", "y", "z"]);
  wbvector2.cross = (a, b) => a.x * b.y - a.y * b.x;
  wbvector2.angle = (a, b) => Math.atan2(a.y - b.y, a.x - b.x);
  wbvector2.intersection = (a, b, c, d) => {
    const first = wbvector2.minus(b, a), second = wbvector2.minus(d, c), between = wbvector2.minus(c, a);
    const area = wbvector2.cross(first, second);
    const s = wbvector2.cross(between, second) / area, t = wbvector2.cross(between, first) / area;
    return s >= 0 && s <= 1 && t >= 0 && t <= 1 ? wbvector2.add(a, wbvector2.multiply(first, s)) : null;
  };
  wbvector3.cross = (a, b) => ({
    x: a.y * b.z - a.z * b.y, y: a.z * b.x - a.x * b.z, z: a.x * b.y - a.y * b.x,
  });
  const normalize = (r) => {
    const axis = wbvector3.normalize(r) || {x: 0, y: 1, z: 0};
    return Object.assign(r, axis, {a: r.a - 2 * Math.PI * Math.round(r.a / (2 * Math.PI))});
  };
  const toQuaternion = (r) => {
    const unit = normalize(r), s = Math.sin(unit.a / 2);
    return {w: Math.cos(unit.a / 2), x: s * unit.x, y: s * unit.y, z: s * unit.z};
  };
  const fromQuaternion = (q) => {
    const length = wbvector3.norm(q), angle = 2 * Math.atan2(length, q.w);
    return length < 1e-12 ? {x: 0, y: 1, z: 0, a: 0} : {x: q.x / length, y: q.y / length, z: q.z / length, a: angle};
  };
  const times = (p, q) => ({
    w: p.w * q.w - p.x * q.x - p.y * q.y - p.z * q.z, x: p.w * q.x + p.x * q.w + p.y * q.z - p.z * q.y,
    y: p.w * q.y - p.x * q.z + p.y * q.w + p.z * q.x, z: p.w * q.z + p.x * q.y - p.y * q.x + p.z * q.w,
  });
  const turn = (q, v) => {
    const {x, y, z} = times(times(q, {w: 0, ...v}), {w: q.w, x: -q.x, y: -q.y, z: -q.z});
    return {x, y, z};
  };
  const wbrotation = {
    normalize, toQuaternion, fromQuaternion,
    equal: (a, b) => wbvector3.equal(a, b) && a.a === b.a,
    isIdentity: (r) => r.a === 0,
    combine: (a, b) => fromQuaternion(times(toQuaternion(a), toQuaternion(b))),
    toMatrix3: (r) => {
      const q = toQuaternion(r);
      const columns = [turn(q, {x: 1, y: 0, z: 0}), turn(q, {x: 0, y: 1, z: 0}), turn(q, {x: 0, y: 0, z: 1})];
      return {...["x", "y", "z"].flatMap((key) => columns.map((column) => column[key]))};
    },
    fromMatrix3: (m) => {
      const axis = {x: m[7] - m[5], y: m[2] - m[6], z: m[3] - m[1]}, trace = m[0] + m[4] + m[8];
      const length = wbvector3.norm(axis);
      if (length > 1e-9) return {...wbvector3.normalize(axis), a: Math.atan2(length, trace - 1)};
      if (trace > 0) return {x: 1, y: 0, z: 0, a: 0};
      const best = [0, 4, 8].reduce((a, b) => m[b] > m[a] ? b : a) / 4;  // half a turn
      const column = [0, 1, 2].map((row) => m[3 * row + best] + (row === best ? 1 : 0));
      return {...wbvector3.normalize({x: column[0], y: column[1], z: column[2]}), a: Math.PI};
    },
    rotateVector3ByMatrix3: (m, v) => ({
      x: m[0] * v.x + m[1] * v.y + m[2] * v.z, y: m[3] * v.x + m[4] * v.y + m[5] * v.z,
      z: m[6] * v.x + m[7] * v.y + m[8] * v.z,
    }),
    rotateVector3ByRotation: (r, v) => turn(toQuaternion(r), v),
    rotateVector3ByQuaternion: turn,
  };
  let state = 0;
  const next = () => (state = (1140671485 * state + 12820163) % 16777216);
  const wbrandom = {
    seed: (s) => { state = s; },
    real: (low, high) => {
      if (high === undefined) [low, high] = [0, low === undefined ? 1 : low];
      return low + next() * (high - low) / 16777215;
    },
    integer: (low, high) => {
      if (high === undefined) [low, high] = low === undefined ? [0, 16777215] : [1, low];
      return low + next() % (1 + high - low);
    },
  };
  const spline = (vector, first) => (points, subdivision) => {
    const extended = (list) => {
      const [last, before] = [list[list.length - 1], list[list.length - 2]], step = vector.minus(last, before);
      return [...list, vector.add(last, step), vector.add(last, vector.multiply(step, 2))];
    };
    const all = extended(extended(points).reverse()).reverse(), curve = [points[0]];
    for (let i = first; i < points.length + 1; ++i) {
      for (let j = 1; j <= subdivision; ++j) {
        const t = j / subdivision;
        const weights = [(1 - t) ** 3, 3 * t ** 3 - 6 * t ** 2 + 4, 1 + 3 * t + 3 * t ** 2 - 3 * t ** 3, t ** 3];
        curve.push(weights.map((w, k) => vector.multiply(all[i - 1 + k], w / 6)).reduce(vector.add));
      }
    }
    return curve;
  };
  const wbgeometry = {
    circle: (radius, div, center, shift) => Array.from({length: div + 1}, (_, i) => {
      const angle = 2 * Math.PI * i / div + shift;
      return {x: center.x + radius * Math.cos(angle), y: center.y + radius * Math.sin(angle)};
    }),
    isPoint2InPolygon: (p, polygon) => polygon.reduce((inside, a, i) => {
      const b = polygon[(i + 1) % polygon.length];
      const crossed = (a.y < p.y) !== (b.y < p.y) && p.x <= a.x + (p.y - a.y) * (b.x - a.x) / (b.y - a.y);
      return inside !== crossed;
    }, false),
    findClosestPoint2InArray: (p, points) =>
      points.reduce((best, v) => wbvector2.distance(p, v) < wbvector2.distance(p, best) ? v : best, points[0] || p),
    isPoint2ArrayClockwise: (points) =>
      points.reduce((sum, a, i) => sum + wbvector2.cross(a, points[(i + 1) % points.length]), 0) > 0,
    bSpline2: spline(wbvector2, 1), bSpline3: spline(wbvector3, 2),
  };
  return {wbutility, wbvector2, wbvector3, wbrotation, wbrandom, wbgeometry};
})();
const console = {log() {}, info() {}, warn() {}, debug() {}, error() {}};
Math.random = () => $modules.wbrandom.real(0, 1);
Date.now = () => 0;
