-- SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
-- SPDX-License-Identifier: Apache-2.0
-- The functions of Webots' Lua modules; a matrix has the keys 1 to 9 in row-major order.
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
  wbfile = {getpathwithoutfilename = function(path) return (path:gsub("[/\\][^/\\]*$", "")) end},
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
