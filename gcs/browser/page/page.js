// The page: a terminal that shows what the server sends, and says who types. See server.py for the messages.
import { Screen } from "./screen.js";

const LARGEST_FONT = 16, SMALLEST_FONT = 7;
const COLUMNS = 80, ROWS = 24; // what every screen of the app fits into
const RETRY_MS = 1000;
const SEAT_TAKEN = 4001, APP_ENDED = 4002;
const BEEP_S = 0.12, BETWEEN_S = 0.2;

const element = (id) => document.getElementById(id);
const main = element("terminal");
const terminal = new Screen("ui-monospace, 'DejaVu Sans Mono', 'Cascadia Mono', Menlo, Consolas, monospace", LARGEST_FONT);
let socket = null, role = "watches", shown = [COLUMNS, ROWS], asked = "";

// the same tab is the same viewer, also after a reload
const viewer = sessionStorage.getItem("viewer") ?? Array.from(crypto.getRandomValues(new Uint8Array(16)), (n) => n.toString(16).padStart(2, "0")).join("");
sessionStorage.setItem("viewer", viewer);

function say(message) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

// ---------------------------------------------------------------------------------------------- size

function largest(shows) { // letters so large that columns and rows of them do, and how many there are
  for (let size = LARGEST_FONT; ; size -= 1) {
    const [wide, high] = terminal.cell(size);
    const found = [Math.floor(main.clientWidth / wide), Math.floor(main.clientHeight / high)];
    if ((found[0] >= shows[0] && found[1] >= shows[1]) || size <= SMALLEST_FONT) {
      terminal.fontSize = size;
      return found;
    }
  }
}

const room = () => largest([COLUMNS, ROWS]);

function fit() {
  if (role !== "flies") { // who watches sees the same columns, as large as they fit
    terminal.resize(...shown);
    largest(shown);
    return;
  }
  const size = room();
  if (`${size}` !== asked) {
    asked = `${size}`;
    say({ size });
  }
}

// ---------------------------------------------------------------------------------------------- what is heard

function told(message) {
  if ("ended" in message) {
    notice(message.ended ? "the app has ended with an error; the terminal that serves it says why" : "the app has ended", true);
    return;
  }
  const before = role;
  role = message.role;
  const others = message.viewers > 1 ? `, ${message.viewers - 1} more look on` : "";
  element("role").textContent = role === "flies" ? `you fly${others}`
    : message.gone ? "you watch; the one who flies is gone" : "you watch; keys are the other's, ABORT is yours too";
  element("take").hidden = role === "flies" || !message.free;
  shown = message.size;
  if (role === "flies") terminal.resize(...shown);
  if (before !== "flies") asked = "";
  fit();
}

function connect() {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  socket = new WebSocket(`${scheme}//${location.host}/screen`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    const size = room();
    asked = "";
    socket.send(JSON.stringify({ viewer, size }));
    notice("");
  };
  socket.onmessage = ({ data }) => {
    if (typeof data === "string") told(JSON.parse(data));
    else terminal.write(new Uint8Array(data));
  };
  socket.onclose = ({ code }) => {
    element("role").textContent = "not connected";
    if (code === APP_ENDED) return;
    if (code === SEAT_TAKEN) notice("this tab was opened a second time; that one goes on", true);
    else {
      notice("CONNECTION LOST: trying again. Without anybody here the app is closed, and a run ended with it");
      setTimeout(connect, RETRY_MS);
    }
  };
}

function notice(words, ended = false) {
  element("words").textContent = words;
  element("again").hidden = !ended;
  element("notice").hidden = !words;
}

// ---------------------------------------------------------------------------------------------- sound

let audio = null, quiet = 0;

function sound() {
  audio ??= new AudioContext();
  audio.resume().then(() => element("sound").setAttribute("aria-pressed", "true"));
}

function beep() {
  document.body.dataset.bells = Number(document.body.dataset.bells ?? 0) + 1;
  if (audio?.state !== "running") return;
  quiet = Math.max(quiet, audio.currentTime);
  const tone = audio.createOscillator(), volume = audio.createGain();
  tone.frequency.value = 880;
  volume.gain.value = 0.3;
  tone.connect(volume).connect(audio.destination);
  tone.start(quiet);
  tone.stop(quiet + BEEP_S);
  quiet += BETWEEN_S; // each of several is heard
}

// ---------------------------------------------------------------------------------------------- keys and fingers

function type(keys) {
  if (role === "flies") say({ keys });
}

terminal.open(main);
terminal.onData = type;
terminal.onBell = beep;
terminal.keyboard.inputMode = "none"; // a finger on the screen presses, and brings no keyboard up
terminal.focus();
window.addEventListener("focus", () => terminal.focus());
window.addEventListener("resize", fit);
window.addEventListener("keydown", (event) => {
  if (event.key === "F12") { // also of who watches; and no developer's tools in the middle of a run
    event.preventDefault();
    event.stopPropagation();
    say({ abort: true });
  } else if (event.target !== terminal.keyboard && !event.ctrlKey && !event.metaKey) terminal.focus(); // those may copy
}, true);
window.addEventListener("pointerdown", sound);
window.addEventListener("keydown", sound, { once: true });
element("abort").addEventListener("pointerdown", () => say({ abort: true })); // as it goes down, not when it is let go
element("abort").addEventListener("click", ({ detail }) => {
  if (detail === 0) say({ abort: true }); // by a key
  terminal.focus();
});
element("take").addEventListener("click", () => { say({ take: true }); terminal.focus(); });
element("again").addEventListener("click", () => location.reload());
element("sound").addEventListener("click", () => { sound(); beep(); });
element("keyboard").addEventListener("click", () => {
  const open = terminal.keyboard.inputMode === "none";
  terminal.keyboard.inputMode = open ? "text" : "none";
  element("keyboard").setAttribute("aria-pressed", `${open}`);
  terminal.blur();
  terminal.focus();
});
for (const button of document.querySelectorAll("[data-keys]")) {
  button.addEventListener("click", () => { type(button.dataset.keys); terminal.focus(); });
}

// a finger presses where it taps; one that moves turns the wheel, row by row
let held = null, moved = false;
const at = (touch) => terminal.place(touch).join(";");

main.addEventListener("touchstart", ({ touches }) => {
  held = touches.length === 1 ? touches[0] : null;
  moved = false;
}, { passive: true });
main.addEventListener("touchmove", (event) => {
  if (held === null) return;
  const now = event.touches[0], rows = Math.trunc((now.clientY - held.clientY) / terminal.cell()[1]);
  if (rows === 0) return;
  event.preventDefault();
  type(`\x1b[<${rows > 0 ? 64 : 65};${at(now)}M`.repeat(Math.abs(rows)));
  [held, moved] = [now, true];
}, { passive: false });
main.addEventListener("touchend", (event) => {
  if (held === null) return;
  event.preventDefault(); // no mouse on top of it
  if (!moved) type(`\x1b[<0;${at(held)}M\x1b[<0;${at(held)}m`);
  held = null;
  terminal.focus();
}, { passive: false });

connect();
