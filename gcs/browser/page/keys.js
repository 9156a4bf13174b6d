// What a key press is to a terminal's program.

const LETTERS = { ArrowUp: "A", ArrowDown: "B", ArrowRight: "C", ArrowLeft: "D", End: "F", Home: "H" };
const FIRST_FOUR = { F1: "P", F2: "Q", F3: "R", F4: "S" };
const NUMBERS = {
  Insert: 2, Delete: 3, PageUp: 5, PageDown: 6,
  F5: 15, F6: 17, F7: 18, F8: 19, F9: 20, F10: 21, F11: 23, F12: 24,
};
const SINGLE = { Enter: "\r", Escape: "\x1b", Tab: "\t", Backspace: "\x7f" };

// "" where the browser shall do with it what it does
export function sequence(event) {
  const { key, code = "", shiftKey: shift, altKey: alt, ctrlKey: ctrl, metaKey } = event;
  if (event.isComposing || metaKey || (key === "Insert" && shift)) return ""; // the last one pastes
  const held = 1 + (shift ? 1 : 0) + (alt ? 2 : 0) + (ctrl ? 4 : 0), more = held > 1 ? `;${held}` : "";
  if (key in LETTERS) return `\x1b[${more && `1${more}`}${LETTERS[key]}`;
  if (key in FIRST_FOUR) return more ? `\x1b[1${more}${FIRST_FOUR[key]}` : `\x1bO${FIRST_FOUR[key]}`;
  if (key in NUMBERS) return `\x1b[${NUMBERS[key]}${more}~`;
  if (key === "Tab" && ctrl) return "";
  if (key === "Tab" && shift) return "\x1b[Z";
  if (key in SINGLE) return (alt ? "\x1b" : "") + SINGLE[key];
  if ([...key].length !== 1) return ""; // a modifier alone, a dead key, what a phone does not name
  if (ctrl && !alt) return control(key, shift);
  if (alt && !ctrl && !event.getModifierState?.("AltGraph")) {
    const letter = /^Key([A-Z])$/.exec(code)?.[1]; // a Mac's option key makes it another one
    return `\x1b${letter === undefined ? key : shift ? letter : letter.toLowerCase()}`;
  }
  return key;
}

function control(key, shift) {
  const lower = key.toLowerCase();
  if (lower === "v" || (shift && lower === "c")) return ""; // pastes, copies
  if (/^[a-z]$/.test(lower)) return String.fromCharCode(lower.charCodeAt(0) & 31);
  if (key === " " || key === "@") return "\0";
  return /^[[\\\]^_]$/.test(key) ? String.fromCharCode(key.charCodeAt(0) & 31) : "";
}

// pasted words, as one piece where the program asked for that; no command can hide in them
export function pasted(text, bracketed) {
  const plain = text.replace(/\r?\n/g, "\r").replaceAll("\x1b", "");
  return bracketed ? `\x1b[200~${plain}\x1b[201~` : plain;
}

// what was typed where a field's text turned into another: what is gone is taken back, the rest is new
export function difference(before, after) {
  const old = [...before], now = [...after];
  let same = 0;
  while (same < old.length && same < now.length && old[same] === now[same]) same += 1;
  return "\x7f".repeat(old.length - same) + now.slice(same).join("").replaceAll("\n", "\r");
}
