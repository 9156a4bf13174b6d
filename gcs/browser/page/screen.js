// A terminal for what a Textual app writes: painted on a canvas, readable as text above it, with keys and mouse.
import { BOLD, DIM, Grid, ITALIC, REVERSE, STRIKE, UNDERLINE } from "./grid.js";
import { paintGlyph } from "./glyphs.js";
import { difference, pasted, sequence } from "./keys.js";

const MOUSE_PRESS = 1000, MOUSE_DRAG = 1002, MOUSE_MOVE = 1003, BRACKETED_PASTE = 2004;
const LONGEST_HOLD_MS = 500; // a frame whose end was lost is shown all the same
const WHEEL_UP = 64, WHEEL_DOWN = 65, MOVES = 32, NO_BUTTON = 3;

const colours = new Map();

function css(colour) {
  let found = colours.get(colour);
  if (found === undefined) {
    if (colours.size > 4096) colours.clear();
    found = `#${colour.toString(16).padStart(6, "0")}`;
    colours.set(colour, found);
  }
  return found;
}

function between(one, other) {
  return (((one >> 1) & 0x7f7f7f) + ((other >> 1) & 0x7f7f7f)) & 0xffffff;
}

export class Screen {
  #grid = new Grid(80, 24);
  #element = document.createElement("div");
  #canvas = document.createElement("canvas");
  #lines = document.createElement("div");
  #context = this.#canvas.getContext("2d", { alpha: false });
  #fonts = [];
  #laid = "";
  #asked = false;
  #heldSince = 0;

  constructor(family, fontSize) {
    this.family = family;
    this.size = fontSize;
    this.onData = this.onBell = () => {};
    this.#grid.onReply = (text) => this.onData(text);
    this.#grid.onBell = () => this.onBell();
    this.#element.className = "screen";
    this.#lines.className = "rows";
    this.keyboard = keyboard(this.#grid, (text) => this.onData(text));
    this.#element.append(this.#canvas, this.#lines, this.keyboard);
  }

  open(parent) {
    parent.append(this.#element);
    this.#lay();
    mouse(this.#lines, this, this.#grid);
    this.keyboard.addEventListener("compositionstart", () => {
      const [wide, high] = this.cell();
      [this.keyboard.style.left, this.keyboard.style.top] = [`${this.#grid.x * wide}px`, `${this.#grid.y * high}px`];
    });
  }

  write(bytes) {
    const held = this.#grid.held;
    this.#grid.write(bytes);
    if (this.#grid.held && !held) this.#heldSince = performance.now();
    this.#ask();
  }

  resize(cols, rows) {
    if (cols !== this.#grid.cols || rows !== this.#grid.height) this.#grid.resize(cols, rows);
    this.#lay();
  }

  get fontSize() {
    return this.size;
  }

  set fontSize(size) {
    this.size = size;
    this.#lay();
  }

  focus() {
    this.keyboard.focus({ preventScroll: true });
  }

  blur() {
    this.keyboard.blur();
  }

  // width and height of a cell in CSS pixels, of this size of letters
  cell(size = this.size) {
    const { wide, high } = this.#measured(size);
    return [wide / devicePixelRatio, high / devicePixelRatio];
  }

  // column and row under a place of the window, from 1
  place({ clientX, clientY }) {
    const [wide, high] = this.cell(), box = this.#lines.getBoundingClientRect();
    const within = (at, most) => Math.max(1, Math.min(1 + Math.floor(at), most));
    return [within((clientX - box.left) / wide, this.#grid.cols), within((clientY - box.top) / high, this.#grid.height)];
  }

  // ---------------------------------------------------------------------------------------------- painting

  #measured(size) { // in the screen's own pixels, whole ones
    this.#context.font = `${size * devicePixelRatio}px ${this.family}`;
    const about = this.#context.measureText("M");
    return {
      advance: about.width,
      wide: Math.max(1, Math.round(about.width)),
      high: Math.max(1, Math.round(about.fontBoundingBoxAscent + about.fontBoundingBoxDescent)),
      baseline: Math.round(about.fontBoundingBoxAscent),
    };
  }

  #lay() {
    const { cols, height } = this.#grid, laid = `${[cols, height, this.size, devicePixelRatio]}`;
    if (laid !== this.#laid) {
      this.#laid = laid;
      const ratio = devicePixelRatio, { advance, wide, high, baseline } = this.#measured(this.size);
      Object.assign(this, { wide, high, baseline });
      [this.#canvas.width, this.#canvas.height] = [cols * wide, height * high];
      const size = { width: `${(cols * wide) / ratio}px`, height: `${(height * high) / ratio}px` };
      for (const layer of [this.#canvas, this.#lines]) Object.assign(layer.style, size);
      Object.assign(this.#lines.style, {
        font: `${this.size}px/${high / ratio}px ${this.family}`,
        letterSpacing: `${(wide - advance) / ratio}px`,
      });
      while (this.#lines.childElementCount > height) this.#lines.lastChild.remove();
      while (this.#lines.childElementCount < height) this.#lines.append(document.createElement("div"));
      for (const line of this.#lines.children) line.style.height = `${high / ratio}px`;
      this.#fonts = ["", "bold ", "italic ", "italic bold "].map((style) => `${style}${this.size * ratio}px ${this.family}`);
      for (const row of this.#grid.rows) row.changed();
    }
    this.#ask();
  }

  #ask() {
    if (this.#asked) return;
    this.#asked = true;
    requestAnimationFrame((now) => {
      this.#asked = false;
      if (this.#grid.held && now - this.#heldSince < LONGEST_HOLD_MS) this.#ask();
      else this.#paint();
    });
  }

  #paint() {
    this.#grid.rows.forEach((row, y) => {
      if (row.from > row.to) return;
      this.#paintRow(row, y);
      row.painted();
      this.#lines.children[y].textContent = this.#grid.line(y);
    });
  }

  #paintRow(row, y) {
    const context = this.#context, { wide, high } = this;
    let { from, to } = row;
    this.font = ""; // restored below, changed by who measures
    if (row.text[from] === "" && from > 0) from -= 1;
    while (row.text[to + 1] === "") to += 1;
    context.save();
    context.beginPath();
    context.rect(from * wide, y * high, (to + 1 - from) * wide, high);
    context.clip();
    const under = (x) => (row.flags[x] & REVERSE ? row.fg[x] : row.bg[x]);
    for (let x = from, end; x <= to; x = end) {
      for (end = x + 1; end <= to && under(end) === under(x); ) end += 1;
      context.fillStyle = css(under(x));
      context.fillRect(x * wide, y * high, (end - x) * wide, high);
    }
    for (let x = from; x <= to; x += 1) this.#paintCell(row, x, y);
    context.restore();
  }

  #paintCell(row, x, y) {
    const text = row.text[x], flags = row.flags[x], ruled = flags & (UNDERLINE | STRIKE);
    if (text === "" || (text === " " && !ruled)) return;
    const context = this.#context, { wide, high, baseline } = this;
    const [fg, bg] = flags & REVERSE ? [row.bg[x], row.fg[x]] : [row.fg[x], row.bg[x]];
    const columns = row.text[x + 1] === "" ? 2 : 1, left = x * wide, top = y * high;
    context.fillStyle = css(flags & DIM ? between(fg, bg) : fg);
    if (text !== " " && !paintGlyph(context, text, left, top, wide, high)) {
      const font = this.#fonts[(flags & BOLD ? 1 : 0) + (flags & ITALIC ? 2 : 0)];
      if (this.font !== font) context.font = this.font = font;
      context.fillText(text, left, top + baseline, text < "\u2000" ? undefined : columns * wide); // other fonts' are made to fit
    }
    const line = Math.max(1, Math.round(high / 16));
    if (flags & UNDERLINE) context.fillRect(left, top + Math.min(baseline + line, high - line), columns * wide, line);
    if (flags & STRIKE) context.fillRect(left, top + Math.round(baseline * 0.67), columns * wide, line);
  }
}

// ------------------------------------------------------------------------------------------------ keys and mouse

function keyboard(grid, type) { // a field that nobody sees: what is typed into it is sent
  const field = document.createElement("textarea");
  for (const [name, value] of Object.entries({
    autocapitalize: "off", autocomplete: "off", autocorrect: "off", spellcheck: "false", "aria-label": "keys for the app",
  })) field.setAttribute(name, value);
  let before = "";
  const empty = () => { before = field.value = ""; };
  field.addEventListener("keydown", (event) => {
    if (event.key.toLowerCase() === "c" && event.ctrlKey && !getSelection().isCollapsed) return; // copies
    const keys = sequence(event);
    if (keys === "") return;
    event.preventDefault();
    type(keys);
  });
  field.addEventListener("beforeinput", ({ inputType }) => { // a phone's keyboard on an empty field
    if (inputType === "deleteContentBackward" && field.value === "") type("\x7f");
  });
  field.addEventListener("input", ({ isComposing }) => {
    const typed = difference(before, field.value);
    if (typed) type(typed);
    before = field.value;
    if (!isComposing) empty();
  });
  field.addEventListener("compositionend", empty);
  field.addEventListener("paste", (event) => {
    event.preventDefault();
    type(pasted(event.clipboardData.getData("text"), grid.modes.has(BRACKETED_PASTE)));
  });
  return field;
}

function mouse(over, screen, grid) { // told as the app asked for; with shift the browser selects instead
  let pressed = null, last = "", turned = 0;
  const listens = () => [MOUSE_PRESS, MOUSE_DRAG, MOUSE_MOVE].some((mode) => grid.modes.has(mode));
  const tell = (event, button, end = "M") => {
    const held = (event.shiftKey ? 4 : 0) + (event.altKey ? 8 : 0) + (event.ctrlKey ? 16 : 0);
    last = screen.place(event).join(";");
    screen.onData(`\x1b[<${button + held};${last}${end}`);
  };
  over.addEventListener("mousedown", (event) => {
    if (event.shiftKey || !listens()) return;
    event.preventDefault();
    getSelection().removeAllRanges();
    screen.focus();
    pressed = event.button;
    tell(event, pressed);
  });
  window.addEventListener("mouseup", (event) => {
    if (event.button !== pressed) return;
    pressed = null;
    tell(event, event.button, "m");
  });
  window.addEventListener("mousemove", (event) => {
    const asked = grid.modes.has(MOUSE_MOVE) || (grid.modes.has(MOUSE_DRAG) && pressed !== null);
    if (!asked || (pressed === null && event.target.parentNode !== over) || screen.place(event).join(";") === last) return;
    tell(event, MOVES + (pressed ?? NO_BUTTON));
  });
  over.addEventListener("wheel", (event) => {
    if (!listens()) return;
    event.preventDefault();
    turned += event.deltaMode === 0 ? event.deltaY / screen.cell()[1] : event.deltaY;
    if (Math.abs(turned) < 1) return;
    tell(event, turned < 0 ? WHEEL_UP : WHEEL_DOWN);
    turned = 0;
  }, { passive: false });
  over.addEventListener("contextmenu", (event) => {
    if (listens() && !event.shiftKey) event.preventDefault();
  });
}
