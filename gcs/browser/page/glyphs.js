// Characters that must join up with their neighbours, whatever the font: lines, blocks and braille's dots.

// left, up, right, down: 1 a thin line, 2 a thick one
const LINES = new Map(
  ("─1010 │0101 ┌0011 ┐1001 └0110 ┘1100 ├0111 ┤1101 ┬1011 ┴1110 ┼1111 ╴1000 ╵0100 ╶0010 ╷0001 "
    + "━2020 ┃0202 ┏0022 ┓2002 ┗0220 ┛2200 ┣0222 ┫2202 ┳2022 ┻2220 ╋2222 ╸2000 ╹0200 ╺0020 ╻0002")
    .split(" ").map((one) => [one[0], [...one.slice(1)].map(Number)]),
);
const CORNERS = new Map([["╭", [1, 1]], ["╮", [-1, 1]], ["╯", [-1, -1]], ["╰", [1, -1]]]); // towards x, y
const QUARTERS = [4, 8, 1, 13, 9, 7, 11, 2, 6, 14]; // U+2596 on: 1 upper left, 2 upper right, 4 lower left, 8 lower right
const SHADES = [0.25, 0.5, 0.75];

// Paints the character in a cell with the context's colour; false where the font shall.
export function paintGlyph(context, character, x, y, wide, high) {
  const code = character.codePointAt(0);
  if (code >= 0x2800 && code <= 0x28ff) dots(context, code - 0x2800, x, y, wide, high);
  else if (code >= 0x2580 && code <= 0x259f) block(context, code, x, y, wide, high);
  else if (LINES.has(character)) lines(context, LINES.get(character), x, y, wide, high);
  else if (CORNERS.has(character)) corner(context, CORNERS.get(character), x, y, wide, high);
  else return false;
  return true;
}

const thin = (wide) => Math.max(1, Math.round(wide / 9));

function dots(context, bits, x, y, wide, high) {
  const size = Math.max(1, Math.round(Math.min(wide / 2, high / 4) * 0.6));
  for (let bit = 0; bit < 8; bit += 1) {
    if (!((bits >> bit) & 1)) continue;
    const column = bit < 6 ? Math.floor(bit / 3) : bit - 6, row = bit < 6 ? bit % 3 : 3;
    context.fillRect(
      x + Math.round(((column + 0.5) * wide) / 2 - size / 2), y + Math.round(((row + 0.5) * high) / 4 - size / 2), size, size,
    );
  }
}

function block(context, code, x, y, wide, high) {
  const part = (left, top, right, bottom) => {
    const [from, over] = [Math.round(left * wide), Math.round(top * high)];
    context.fillRect(x + from, y + over, Math.round(right * wide) - from, Math.round(bottom * high) - over);
  };
  const at = code - 0x2580;
  if (at === 0) part(0, 0, 1, 0.5);
  else if (at <= 8) part(0, 1 - at / 8, 1, 1);
  else if (at <= 15) part(0, 0, (16 - at) / 8, 1);
  else if (at === 16) part(0.5, 0, 1, 1);
  else if (at <= 19) {
    context.globalAlpha = SHADES[at - 17];
    part(0, 0, 1, 1);
    context.globalAlpha = 1;
  } else if (at === 20) part(0, 0, 1, 1 / 8);
  else if (at === 21) part(7 / 8, 0, 1, 1);
  else {
    const corners = QUARTERS[at - 22];
    for (let bit = 0; bit < 4; bit += 1) {
      if ((corners >> bit) & 1) part((bit % 2) / 2, (bit >> 1) / 2, (bit % 2) / 2 + 0.5, (bit >> 1) / 2 + 0.5);
    }
  }
}

function middle(x, y, wide, high, size) { // upper left of a line's crossing
  return [x + Math.floor((wide - size) / 2), y + Math.floor((high - size) / 2)];
}

function lines(context, [left, up, right, down], x, y, wide, high) {
  const size = thin(wide) * Math.max(left, up, right, down), [cx, cy] = middle(x, y, wide, high, size);
  if (left) context.fillRect(x, cy, cx + size - x, size);
  if (right) context.fillRect(cx, cy, x + wide - cx, size);
  if (up) context.fillRect(cx, y, size, cy + size - y);
  if (down) context.fillRect(cx, cy, size, y + high - cy);
}

function corner(context, [towards, along], x, y, wide, high) {
  const size = thin(wide), [left, top] = middle(x, y, wide, high, size), [cx, cy] = [left + size / 2, top + size / 2];
  const [endX, endY] = [towards > 0 ? x + wide : x, along > 0 ? y + high : y];
  const radius = Math.min(Math.abs(endX - cx), Math.abs(endY - cy));
  context.strokeStyle = context.fillStyle;
  context.lineWidth = size;
  context.beginPath();
  context.moveTo(endX, cy);
  context.arcTo(cx, cy, cx, endY, radius);
  context.lineTo(cx, endY);
  context.stroke();
}
