# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Libraries for the JavaScript and Lua templates of PROTO files."""

# The functions documented at https://cyberbotics.com/doc/reference/javascript-procedural-proto. A rotation is
# {x, y, z, a}, a quaternion {w, x, y, z}, a matrix has the keys 0 to 8 in row-major order. Random numbers are Webots'
# sequence, also in Math.random, and the clock is constant, so that loading a world is deterministic.
JAVASCRIPT = """
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
"""

# Lua's standard functions without files, processes, code from strings, and functions that could catch the error of the
# time limit; `require` finds them and the modules below.
LUA = """
function(code, fields, limit, modules)
  local quiet = function() end
  local stream = {write = quiet, flush = quiet, close = quiet}
  local found = {
    math = math, string = string, table = table, bit32 = bit32, ipairs = ipairs, pairs = pairs, next = next,
    select = select, tonumber = tonumber, tostring = tostring, type = type, unpack = table.unpack, error = error,
    assert = assert, print = quiet, io = {stderr = stream, stdout = stream, write = quiet},
    os = {time = function() return 0 end, clock = function() return 0 end},
    debug = {getinfo = function() return {source = "template", short_src = "template", currentline = 0} end},
  }
  found._G = found
  found.table.maxn = function(list)  -- of Lua 5.1, which Webots' engine still has
    local most = 0
    for key in pairs(list) do if type(key) == "number" and key > most then most = key end end
    return most
  end
  local loaded
  found.require = function(name)
    if type(found[name]) == "table" then return found[name] end
    loaded = loaded or load(modules, "=modules", "t", found)()
    return loaded[name] or error("module '" .. tostring(name) .. "' not found", 2)
  end
  math.randomseed(0)
  for _, text in ipairs({fields, code}) do
    local program, message = load(text, "=template", "t", found)
    if not program then error(message, 0) end
    debug.sethook(function() error("the time limit", 2) end, "", limit)
    local done, result = pcall(program)
    debug.sethook()
    if not done then error(result, 0) end
    found.result = result
  end
  return found.result
end
"""

# The functions of Webots' Lua modules; a matrix has the keys 1 to 9 in row-major order.
LUA_MODULES = """
local core, geometry, random, rotation = {}, {}, {}, {}

function core.tablelength(list)
  local count = 0
  for _ in ipairs(list) do count = count + 1 end
  return count
end

function core.deepcopy(value)
  if type(value) ~= "table" then return value end
  local copy = {}
  for key, item in pairs(value) do copy[core.deepcopy(key)] = core.deepcopy(item) end
  return copy
end

local function vectors(keys)
  local v = {}
  local function each(make)
    local result = {}
    for _, key in ipairs(keys) do result[key] = make(key) end
    return result
  end
  function v.dot(a, b)
    local sum = 0
    for _, key in ipairs(keys) do sum = sum + a[key] * b[key] end
    return sum
  end
  function v.equal(a, b)
    for _, key in ipairs(keys) do if a[key] ~= b[key] then return false end end
    return true
  end
  function v.add(a, b) return each(function(key) return a[key] + b[key] end) end
  function v.minus(a, b) return each(function(key) return a[key] - b[key] end) end
  function v.multiply(a, s) return each(function(key) return s * a[key] end) end
  function v.norm(a) return math.sqrt(v.dot(a, a)) end
  function v.distance(a, b) return v.norm(v.minus(a, b)) end
  function v.normalize(a)
    local length = v.norm(a)
    if length == 0 then error("a vector of length 0 has no direction") end
    return v.multiply(a, 1 / length)
  end
  return v
end
local vector2, vector3 = vectors({"x", "y"}), vectors({"x", "y", "z"})
function vector2.cross(a, b) return a.x * b.y - a.y * b.x end
function vector2.atan2(a) return math.atan2(a.x, a.y) end
function vector2.angle(a, b) return vector2.atan2(vector2.minus(a, b)) end
function vector2.intersection(a, b, c, d)
  local first, second, between = vector2.minus(b, a), vector2.minus(d, c), vector2.minus(c, a)
  local area = vector2.cross(first, second)
  local s, t = vector2.cross(between, second) / area, vector2.cross(between, first) / area
  if s >= 0 and s <= 1 and t >= 0 and t <= 1 then return vector2.add(a, vector2.multiply(first, s)) end
end
function vector3.cross(a, b)
  return {x = a.y * b.z - a.z * b.y, y = a.z * b.x - a.x * b.z, z = a.x * b.y - a.y * b.x}
end

local state = 0
local function draw()
  state = (1140671485 * state + 12820163) % 16777216
  return state
end
function random.seed(s) state = s end
function random.real(low, high)
  if not high then low, high = 0, low or 1 end
  return low + draw() * (high - low) / 16777215
end
function random.integer(low, high)
  if not low then low, high = 0, 16777215 elseif not high then low, high = 1, low end
  return low + draw() % (1 + high - low)
end

function rotation.equal(a, b) return vector3.equal(a, b) and a.a == b.a end
function rotation.isvalid(r) return r.x ~= 0 or r.y ~= 0 or r.z ~= 0 end
function rotation.isidentity(r) return r.a == 0 end
function rotation.normalizeangle(r) r.a = r.a - 2 * math.pi * math.floor(r.a / (2 * math.pi) + 0.5) end
function rotation.normalizeaxis(r)
  local axis = rotation.isvalid(r) and vector3.normalize(r) or {x = 0, y = 1, z = 0}
  r.x, r.y, r.z = axis.x, axis.y, axis.z
end
function rotation.normalize(r)
  rotation.normalizeaxis(r)
  rotation.normalizeangle(r)
  return r
end
function rotation.toquaternion(r)
  local axis = vector3.multiply(rotation.normalize(r), math.sin(r.a / 2))
  return {w = math.cos(r.a / 2), x = axis.x, y = axis.y, z = axis.z}
end
function rotation.fromquaternion(q)
  local length = vector3.norm(q)
  if length < 1e-12 then return {x = 0, y = 1, z = 0, a = 0} end
  return {x = q.x / length, y = q.y / length, z = q.z / length, a = 2 * math.atan2(length, q.w)}
end
function rotation.combine(a, b)
  local p, q = rotation.toquaternion(a), rotation.toquaternion(b)
  local v = vector3.add(vector3.add(vector3.multiply(q, p.w), vector3.multiply(p, q.w)), vector3.cross(p, q))
  v.w = p.w * q.w - vector3.dot(p, q)
  return rotation.fromquaternion(v)
end
function rotation.rotatevector3byrotation(r, v)
  local axis, c, s = rotation.normalize({x = r.x, y = r.y, z = r.z, a = r.a}), math.cos(r.a), math.sin(r.a)
  local along = vector3.multiply(axis, (1 - c) * vector3.dot(axis, v))
  return vector3.add(vector3.add(vector3.multiply(v, c), vector3.multiply(vector3.cross(axis, v), s)), along)
end
function rotation.rotatevector3byquaternion(q, v)
  return rotation.rotatevector3byrotation(rotation.fromquaternion(q), v)
end
function rotation.rotatevector3bymatrix3(m, v)
  local function row(i) return m[i] * v.x + m[i + 1] * v.y + m[i + 2] * v.z end
  return {x = row(1), y = row(4), z = row(7)}
end
function rotation.tomatrix3(r)
  local m = {}
  for i, key in ipairs({"x", "y", "z"}) do
    local column = rotation.rotatevector3byrotation(r, {x = 0, y = 0, z = 0, [key] = 1})
    m[i], m[i + 3], m[i + 6] = column.x, column.y, column.z
  end
  return m
end
function rotation.frommatrix3(m)
  local c = (m[1] + m[5] + m[9] - 1) / 2
  if math.abs(c) > 1 then return {x = 1, y = 0, z = 0, a = 0} end
  return {x = m[8] - m[6], y = m[3] - m[7], z = m[4] - m[2], a = math.acos(c)}
end

function geometry.circle(radius, count, x, y, shift)
  local points = {}
  for i = 0, count do
    local angle = 2 * math.pi * i / count + shift
    points[i + 1] = {x = x + radius * math.cos(angle), y = y + radius * math.sin(angle)}
  end
  return points
end
function geometry.ispointinpolygon(x, y, polygon)
  local inside = false
  for i, a in ipairs(polygon) do
    local b = polygon[i + 1] or polygon[1]
    if (a.y < y) ~= (b.y < y) and x <= a.x + (y - a.y) * (b.x - a.x) / (b.y - a.y) then inside = not inside end
  end
  return inside
end
function geometry.findclosest2Dpointinarray(point, points)
  local best = points[1] or point
  for _, other in ipairs(points) do
    if vector2.distance(point, other) < vector2.distance(point, best) then best = other end
  end
  return best
end
function geometry.islistclockwise2D(points)
  local sum = 0
  for i, a in ipairs(points) do sum = sum + vector2.cross(a, points[i + 1] or points[1]) end
  return sum > 0
end
local function spline(v, first)
  return function(points, subdivision)
    local count = core.tablelength(points)
    local function at(i)
      if i < 1 then return v.add(points[1], v.multiply(v.minus(points[1], points[2]), 1 - i)) end
      if i <= count then return points[i] end
      return v.add(points[count], v.multiply(v.minus(points[count], points[count - 1]), i - count))
    end
    local curve = {points[1]}
    for i = first, count - 1 do
      for j = 1, subdivision do
        local t = j / subdivision
        local weights = {(1 - t) ^ 3, 3 * t ^ 3 - 6 * t ^ 2 + 4, 1 + 3 * t + 3 * t ^ 2 - 3 * t ^ 3, t ^ 3}
        local point = v.multiply(at(i - 1), weights[1] / 6)
        for k = 2, 4 do point = v.add(point, v.multiply(at(i - 2 + k), weights[k] / 6)) end
        curve[#curve + 1] = point
      end
    end
    return curve
  end
end
geometry.bspline2D, geometry.bspline3D = spline(vector2, 0), spline(vector3, 1)

return {
  wbcore = core, wbgeometry = geometry, wbrandom = random, wbrotation = rotation, wbvector2 = vector2,
  wbvector3 = vector3, wblimits = {maxdouble = 2 ^ 53, mindouble = -2 ^ 53},
  wbmath = {round = function(number) return math.floor(number + 0.5) end},
  wbfile = {getpathwithoutfilename = function(path) return (path:gsub("[/\\\\][^/\\\\]*$", "")) end},
  wbstring = {split = function(text, pattern)
    local parts, from = {}, 1
    local first, last = text:find(pattern, from)
    while first and last >= first do
      if first > 1 then parts[#parts + 1] = text:sub(from, first - 1) end
      from = last + 1
      first, last = text:find(pattern, from)
    end
    if from <= #text then parts[#parts + 1] = text:sub(from) end
    return parts
  end},
}
"""
