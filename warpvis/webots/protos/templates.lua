-- SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
-- SPDX-License-Identifier: Apache-2.0
-- Lua's standard functions without files, processes, code from strings, and functions that could catch the error of the
-- time limit; `require` finds them and the modules of template_modules.lua.
return function(code, fields, limit, modules)
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
