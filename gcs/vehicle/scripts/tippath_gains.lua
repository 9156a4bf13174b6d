--[[
Two sets of rate gains, and the pilot's hand between them. For ArduCopter 4.5 and later, multicopter and helicopter.

The set that the autopilot has stays where it is. A new one is written to this script's own parameters and committed by
its checksum, on the ground and disarmed. It flies while the switch is high, and was low since; the values are set, not
saved, so that a restart flies the old set. Low, middle, no radio, no switch: the old set flies.

  TPG_RLL_P ... TPG_PIT_FF      the new set, as it is written
  TPG_O_RLL_P ... TPG_O_PIT_FF  the set that it was committed beside
  TPG_COMMIT    write the checksum of the new set to take it, -1 to forget it; 0 again when that is done
  TPG_ACTIVE    checksum of the set behind the switch; 0: none
  TPG_FLIES     1 while the new set flies
  TPG_FUNC      RCn_OPTION of the switch's channel (300: Scripting1)

SCR_ENABLE 1, this file into APM/scripts on the card, RCn_OPTION 300 for the switch's channel n, restart.
--]]

local KEY = 137 -- of the table of parameters: another where another script has it
local PREFIX = "TPG_"
local EVERY_MS = 100
local WARNING, INFO = 4, 6
local HIGH, LOW = 2, 0

local function say(severity, text)
  gcs:send_text(severity, "tippath gains: " .. text)
end

local made = 0
local function add(name, value)
  made = made + 1
  assert(param:add_param(KEY, made, name, value), "tippath gains: no parameter " .. PREFIX .. name)
  return Parameter(PREFIX .. name)
end

assert(param:add_table(KEY, PREFIX, 20), "tippath gains: another script has the table of parameters, change KEY")
local flown, new, old = {}, {}, {}
for _, axis in ipairs({ "RLL", "PIT" }) do
  for _, gain in ipairs({ "P", "I", "D", "FF" }) do
    local at = #flown + 1
    flown[at] = Parameter("ATC_RAT_" .. axis .. "_" .. gain)
    new[at] = add(axis .. "_" .. gain, 0)
    old[at] = add("O_" .. axis .. "_" .. gain, 0)
  end
end
local commit, active = add("COMMIT", 0), add("ACTIVE", 0)
local flies, func = add("FLIES", 0), add("FUNC", 300)

local function values(of)
  local found = {}
  for at, one in ipairs(of) do
    found[at] = one:get()
  end
  return found
end

local function equal(a, b)
  for at = 1, #a do
    if a[at] ~= b[at] then
      return false
    end
  end
  return true
end

-- 24 bits of CRC-32 over the values as little-endian float32: as many as a parameter carries exactly
local function checksum(set)
  local crc = 0xFFFFFFFF
  for _, value in ipairs(set) do
    for _, byte in ipairs({ string.byte(string.pack("<f", value), 1, 4) }) do
      crc = crc ~ byte
      for _ = 1, 8 do
        local odd = crc & 1
        crc = crc >> 1
        if odd == 1 then
          crc = crc ~ 0xEDB88320
        end
      end
    end
  end
  return (~crc) & 0xFFFFFF
end

local function hex(crc)
  return string.format("%06x", crc)
end

local behind = nil -- the set behind the switch
local before = values(old) -- the one that it was committed beside
local seen_low = false
local flying = false
local told = false

local function set_all(set)
  for at, one in ipairs(flown) do
    one:set(set[at])
  end
end

local function let_go()
  if flying then
    set_all(before)
    flying = false
    flies:set(0)
    say(INFO, "old set flies")
  end
end

local function begin()
  local crc = active:get()
  if crc == 0 then
    return
  end
  local set = values(new)
  if checksum(set) ~= crc then
    active:set_and_save(0)
    say(WARNING, "set " .. hex(math.floor(crc)) .. " is damaged, and forgotten")
    return
  end
  behind = set
  -- a restart of scripts alone leaves what flew
  flying = equal(values(flown), set) and not equal(set, before)
  flies:set(flying and 1 or 0)
end

local function take(wanted)
  if arming:is_armed() then
    say(WARNING, "commit refused: armed")
    return
  end
  let_go()
  seen_low, told = false, false
  if wanted == -1 then
    behind = nil
    active:set_and_save(0)
    say(INFO, "no new set")
    return
  end
  local set = values(new)
  local crc = checksum(set)
  if crc ~= wanted then
    say(WARNING, "commit refused: CRC " .. hex(math.floor(wanted)) .. ", new set " .. hex(crc))
    return
  end
  before = values(flown)
  for at, one in ipairs(old) do
    one:set_and_save(before[at])
  end
  behind = set
  active:set_and_save(crc)
  say(INFO, "set " .. hex(crc) .. " is behind the switch")
end

local function position()
  local channel = rc:find_channel_for_option(math.floor(func:get()))
  if channel == nil or not rc:has_valid_input() then
    return nil
  end
  return channel:get_aux_switch_pos()
end

local function update()
  local wanted = commit:get()
  if wanted ~= 0 then
    take(wanted)
    commit:set_and_save(0)
  end
  local at = position()
  seen_low = seen_low or at == LOW
  if at ~= HIGH or behind == nil then
    let_go()
    told = false
  elseif not flying and not told then
    told = true
    if not seen_low then
      say(WARNING, "switch was not low since the commit: old set flies")
    elseif not equal(values(flown), before) then
      say(WARNING, "gains are others than at the commit: nothing is switched")
    else
      set_all(behind)
      flying = true
      flies:set(1)
      say(INFO, "new set flies")
    end
  end
  return update, EVERY_MS
end

begin()
return update()
