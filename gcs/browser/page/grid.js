// What the terminal holds: rows of cells, and the state machine that turns what a Textual app writes into them.

export const BOLD = 1, DIM = 2, ITALIC = 4, UNDERLINE = 8, REVERSE = 16, STRIKE = 32;
export const FOREGROUND = 0xe0e0e0, BACKGROUND = 0x111111;

const GROUND = 0, ESCAPE = 1, CHARSET = 2, CSI = 3, STRING = 4, STRING_ESCAPE = 5;
const LONGEST_CSI = 256, TAB = 8;
const SYNCHRONIZED = 2026, OTHER_SCREENS = [47, 1047, 1049];
const ON = { 1: BOLD, 2: DIM, 3: ITALIC, 4: UNDERLINE, 7: REVERSE, 9: STRIKE, 21: UNDERLINE };
const OFF = { 22: BOLD | DIM, 23: ITALIC, 24: UNDERLINE, 27: REVERSE, 29: STRIKE };
const SIXTEEN = [
  0x000000, 0xcd3131, 0x0dbc79, 0xe5e510, 0x2472c8, 0xbc3fbc, 0x11a8cd, 0xe5e5e5,
  0x666666, 0xf14c4c, 0x23d18b, 0xf5f543, 0x3b8eea, 0xd670d6, 0x29b8db, 0xffffff,
];
const WIDE = /[\u1100-\u115f\u2e80-\u303e\u3041-\ua4cf\uac00-\ud7a3\uf900-\ufaff\ufe30-\ufe6f\uff00-\uff60\uffe0-\uffe6\u{20000}-\u{3fffd}\p{Emoji_Presentation}]/u;
const JOINS = /[\p{Mn}\p{Me}\p{Cf}]/u;

// 24-bit colour of a number of 256: sixteen, a cube of six steps, greys
export function indexed(number) {
  if (number < 16) return SIXTEEN[number];
  if (number >= 232) return (8 + 10 * (number - 232)) * 0x10101;
  const step = (at) => (at === 0 ? 0 : 55 + 40 * at), at = number - 16;
  return (step(Math.floor(at / 36)) << 16) | (step(Math.floor(at / 6) % 6) << 8) | step(at % 6);
}

class Row {
  constructor(cols, background = BACKGROUND) {
    this.text = new Array(cols).fill(" "); // the second half of a wide character is ""
    this.fg = new Int32Array(cols).fill(FOREGROUND);
    this.bg = new Int32Array(cols).fill(background);
    this.flags = new Uint8Array(cols);
    this.changed();
  }

  changed() { // all of it
    [this.from, this.to] = [0, this.text.length - 1];
  }

  painted() {
    [this.from, this.to] = [this.text.length, -1];
  }

  set(x, text, fg, bg, flags) {
    if (this.text[x] === text && this.fg[x] === fg && this.bg[x] === bg && this.flags[x] === flags) return;
    [this.text[x], this.fg[x], this.bg[x], this.flags[x]] = [text, fg, bg, flags];
    if (x < this.from) this.from = x;
    if (x > this.to) this.to = x;
  }

  cut(x) { // what is left of a wide character whose second half is at x
    if (this.text[x] !== "" || x === 0) return;
    for (const half of [x - 1, x]) this.set(half, " ", this.fg[half], this.bg[half], this.flags[half]);
  }
}

export class Grid {
  #decoder = new TextDecoder("utf-8", { ignoreBOM: true });
  #state = GROUND;
  #csi = "";

  constructor(cols, rows) {
    [this.cols, this.height] = [cols, rows];
    this.onBell = this.onReply = () => {};
    this.reset();
  }

  reset() {
    this.rows = Array.from({ length: this.height }, () => new Row(this.cols));
    this.modes = new Set();
    [this.x, this.y] = [0, 0];
    this.#plain();
  }

  get held() { // in the middle of a frame
    return this.modes.has(SYNCHRONIZED);
  }

  resize(cols, height) {
    const before = this.rows;
    [this.cols, this.height] = [cols, height];
    this.rows = Array.from({ length: height }, (_, y) => {
      const row = new Row(cols), old = before[y];
      for (let x = 0; old && x < Math.min(cols, old.text.length); x += 1) row.set(x, old.text[x], old.fg[x], old.bg[x], old.flags[x]);
      return row;
    });
    [this.x, this.y] = [Math.min(this.x, cols - 1), Math.min(this.y, height - 1)];
  }

  write(bytes) {
    for (const character of this.#decoder.decode(bytes, { stream: true })) this.#step(character);
  }

  line(y) {
    return this.rows[y].text.join("");
  }

  // ---------------------------------------------------------------------------------------------- parser

  #step(character) {
    const code = character.codePointAt(0);
    if (this.#state >= STRING) this.#inString(code);
    else if (code === 0x1b) this.#state = ESCAPE;
    else if (code < 0x20 || (code >= 0x7f && code < 0xa0)) this.#control(code);
    else if (this.#state === GROUND) this.#put(character);
    else if (this.#state === CSI) this.#inCsi(character, code);
    else if (this.#state === CHARSET) this.#state = GROUND;
    else this.#afterEscape(character);
  }

  #inString(code) { // titles, links, pointers: skipped up to BEL or ESC \
    if (code === 0x07 || (this.#state === STRING_ESCAPE && code === 0x5c)) this.#state = GROUND;
    else this.#state = code === 0x1b ? STRING_ESCAPE : STRING;
  }

  #inCsi(character, code) {
    if (code < 0x40) {
      if (this.#csi.length < LONGEST_CSI) this.#csi += character;
      return;
    }
    this.#state = GROUND;
    const body = this.#csi, mark = /[<=>?]/.test(body[0] ?? "") ? body[0] : "";
    const numbers = (body.slice(mark.length).match(/^[\d;:]*/)[0]).split(/[;:]/).map(Number);
    if (mark === "?") this.#mode(numbers, body.endsWith("$") ? `$${character}` : character);
    else if (mark === "" && /^[\d;:]*$/.test(body)) this.#command(numbers, character);
  }

  #afterEscape(character) {
    this.#state = GROUND;
    if (character === "[") [this.#state, this.#csi] = [CSI, ""];
    else if ("]PX^_".includes(character)) this.#state = STRING;
    else if ("()*+-./# %".includes(character)) this.#state = CHARSET;
    else if (character === "c") this.reset();
  }

  #control(code) {
    if (code === 0x07) this.onBell();
    else if (code === 0x08) this.x = Math.max(Math.min(this.x, this.cols - 1) - 1, 0);
    else if (code === 0x09) this.x = Math.min((Math.floor(this.x / TAB) + 1) * TAB, this.cols - 1);
    else if (code === 0x0a) this.#lineFeed();
    else if (code === 0x0d) this.x = 0;
  }

  #mode(numbers, final) {
    if (final === "$p" && numbers[0] === SYNCHRONIZED) this.onReply(`\x1b[?${SYNCHRONIZED};2$y`);
    if (final !== "h" && final !== "l") return;
    for (const number of numbers) {
      if (final === "h") this.modes.add(number);
      else this.modes.delete(number);
      if (OTHER_SCREENS.includes(number)) this.#eraseRows(0, this.height);
    }
  }

  #command(numbers, final) {
    const first = numbers[0], many = first || 1;
    switch (final) {
      case "A": case "F": this.#to(final === "F" ? 0 : this.x, this.y - many); break;
      case "B": case "E": this.#to(final === "E" ? 0 : this.x, this.y + many); break;
      case "C": this.#to(this.x + many, this.y); break;
      case "D": this.#to(Math.min(this.x, this.cols - 1) - many, this.y); break;
      case "G": this.#to(many - 1, this.y); break;
      case "H": case "f": this.#to((numbers[1] || 1) - 1, many - 1); break;
      case "d": this.#to(this.x, many - 1); break;
      case "J": this.#eraseScreen(first); break;
      case "K": this.#eraseLine(first); break;
      case "m": this.#style(numbers); break;
    }
  }

  #style(numbers) {
    for (let at = 0; at < numbers.length; at += 1) {
      const number = numbers[at];
      if (number === 0) this.#plain();
      else if (number in ON) this.flags |= ON[number];
      else if (number in OFF) this.flags &= ~OFF[number];
      else if (number === 38 || number === 48) {
        const given = numbers[at + 1] === 5 ? [indexed(numbers[at + 2] & 255), 2]
          : numbers[at + 1] === 2 ? [((numbers[at + 2] & 255) << 16) | ((numbers[at + 3] & 255) << 8) | (numbers[at + 4] & 255), 4] : null;
        if (given === null) return;
        if (number === 38) this.fg = given[0];
        else this.bg = given[0];
        at += given[1];
      } else if (number === 39) this.fg = FOREGROUND;
      else if (number === 49) this.bg = BACKGROUND;
      else if (number >= 30 && number < 38) this.fg = SIXTEEN[number - 30];
      else if (number >= 40 && number < 48) this.bg = SIXTEEN[number - 40];
      else if (number >= 90 && number < 98) this.fg = SIXTEEN[number - 82];
      else if (number >= 100 && number < 108) this.bg = SIXTEEN[number - 92];
    }
  }

  #plain() {
    [this.fg, this.bg, this.flags] = [FOREGROUND, BACKGROUND, 0];
  }

  // ---------------------------------------------------------------------------------------------- cells

  #put(character) {
    const code = character.codePointAt(0);
    if (code >= 0x300 && JOINS.test(character)) {
      this.#join(character);
      return;
    }
    const wide = code >= 0x1100 && WIDE.test(character) ? 2 : 1;
    if (this.x + wide > this.cols) { // x is one past the last column until more is written
      this.x = 0;
      this.#lineFeed();
    }
    const row = this.rows[this.y];
    row.cut(this.x);
    if (this.x + wide < this.cols) row.cut(this.x + wide);
    row.set(this.x, character, this.fg, this.bg, this.flags);
    if (wide === 2 && this.x + 1 < this.cols) row.set(this.x + 1, "", this.fg, this.bg, this.flags);
    this.x += wide;
  }

  #join(character) { // an accent, a variation: part of what stands before it
    const row = this.rows[this.y];
    let x = this.x - 1;
    if (x > 0 && row.text[x] === "") x -= 1;
    if (x >= 0) row.set(x, row.text[x] + character, row.fg[x], row.bg[x], row.flags[x]);
  }

  #to(x, y) {
    this.x = Math.max(0, Math.min(x, this.cols - 1));
    this.y = Math.max(0, Math.min(y, this.height - 1));
  }

  #lineFeed() {
    if (this.y < this.height - 1) this.y += 1;
    else {
      this.rows.shift();
      this.rows.push(new Row(this.cols, this.bg));
      for (const row of this.rows) row.changed();
    }
  }

  #erase(y, from, to) {
    const row = this.rows[y];
    row.cut(from);
    if (to < this.cols) row.cut(to);
    for (let x = from; x < to; x += 1) row.set(x, " ", FOREGROUND, this.bg, 0);
  }

  #eraseRows(from, to) {
    for (let y = from; y < to; y += 1) this.#erase(y, 0, this.cols);
  }

  #eraseLine(how) {
    const x = Math.min(this.x, this.cols - 1);
    this.#erase(this.y, how === 0 ? x : 0, how === 1 ? x + 1 : this.cols);
  }

  #eraseScreen(how) {
    if (how < 2) this.#eraseLine(how);
    if (how !== 1) this.#eraseRows(how === 0 ? this.y + 1 : 0, this.height);
    else this.#eraseRows(0, this.y);
  }
}
