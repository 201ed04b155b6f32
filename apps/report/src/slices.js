// Three planes through the middle of the tool's path: labels, nodes, base, outlines, tool.
import { at, data, element, svg } from './numbers.js';

// Pale colours, so that nodes are visible; grey for labels that are not part of the body.
const tints = ['#DCE6F1', '#F3E2D3', '#DDEBDD', '#EADFEF', '#F6EDCB', '#D6ECEC', '#F2DCE0', '#E4E4D4'];
const others = '#EDEDED';

export const taken = (at('labels') ?? []).map((label) => label.value);
export const tintOf = (label) => (taken.includes(label) ? tints[taken.indexOf(label) % tints.length] : others);

/** Picture of the labels, from run lengths "label, count" row by row. */
function labelPicture({ columns, rows, labels }) {
  const canvas = element('canvas', { width: columns, height: rows });
  const context = canvas.getContext('2d');
  let place = 0;
  for (let k = 0; k < labels.length; k += 2) {
    let left = labels[k + 1];
    context.fillStyle = labels[k] === 0 ? '#FFFFFF' : tintOf(labels[k]);
    while (left > 0) {
      const column = place % columns;
      const here = Math.min(left, columns - column);
      context.fillRect(column, Math.floor(place / columns), here, 1);
      place += here;
      left -= here;
    }
  }
  return canvas.toDataURL();
}

const mm = (hundredth) => (hundredth / 100).toFixed(2);

const dots = (numbers) => {
  let path = '';
  for (let k = 0; k + 1 < numbers.length; k += 2) path += `M${mm(numbers[k])} ${mm(numbers[k + 1])}h0`;
  return path;
};
const pieces = (numbers = []) => {
  let path = '';
  for (let k = 0; k + 3 < numbers.length; k += 4) path += `M${mm(numbers[k])} ${mm(numbers[k + 1])}L${mm(numbers[k + 2])} ${mm(numbers[k + 3])}`;
  return path;
};

/** Corners of the hull of points in a plane, in order (Andrew 1979). */
function hull(points) {
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const turns = (o, a, b) => (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
  const half = (list) => {
    const kept = [];
    for (const p of list) {
      while (kept.length > 1 && turns(kept[kept.length - 2], kept[kept.length - 1], p) <= 0) kept.pop();
      kept.push(p);
    }
    return kept.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}
const pairs = (numbers) => Array.from({ length: numbers.length / 2 }, (_, k) => [numbers[2 * k], numbers[2 * k + 1]]);

function slice(one, pixelsPerMm) {
  const { width_mm: w, height_mm: h } = one;
  const tool = pairs(one.tool);
  const above = Math.min(0, ...tool.map((p) => p[1] / 100));
  const below = Math.max(h, ...tool.map((p) => p[1] / 100));
  const left = Math.min(0, ...tool.map((p) => p[0] / 100));
  const right = Math.max(w, ...tool.map((p) => p[0] / 100));
  const edge = 12 / pixelsPerMm + 1; // room for the letters
  const box = [left - edge, above - edge, right - left + 2 * edge, below - above + 2 * edge];
  const size = 13 / pixelsPerMm;
  const picture = svg('svg', {
    viewBox: box.map((x) => x.toFixed(2)).join(' '),
    class: 'slice',
    role: 'img',
    'aria-label': `${one.name} plane`,
    style: `--mm:${(1 / pixelsPerMm).toFixed(4)}`,
  });
  if (one.columns > 0)
    picture.append(svg('image', { href: labelPicture(one), x: 0, y: 0, width: w, height: h, preserveAspectRatio: 'none', style: 'image-rendering:pixelated' }));
  picture.append(
    svg('path', { class: 'rest', d: pieces(one.outline_at_rest) }),
    svg('path', { class: 'node', d: dots(one.nodes.free) }),
    svg('path', { class: 'node base', d: dots(one.nodes.base) }),
    svg('path', { class: 'node circle', d: dots(one.nodes.circle) }),
    svg('path', { class: 'wall', d: pieces(one.walls) }),
    svg('path', { class: 'moved', d: pieces(one.outline_at_end) }),
    ...(tool.length > 0 ? [svg('path', { class: 'tool', d: `M${hull(tool).map((p) => `${mm(p[0])} ${mm(p[1])}`).join('L')}Z` })] : []),
  );
  const letter = (text, x, y) =>
    picture.append(svg('text', { x: x.toFixed(2), y: (y + 0.36 * size).toFixed(2), 'font-size': size.toFixed(2), 'text-anchor': 'middle', class: 'letter' }, text));
  const [l, r, t, b] = one.letters;
  letter(l, box[0] + 0.7 * size, h / 2);
  letter(r, box[0] + box[2] - 0.7 * size, h / 2);
  letter(t, w / 2, box[1] + 0.8 * size);
  letter(b, w / 2, box[1] + box[3] - 0.7 * size);
  const bar = [1, 2, 5, 10, 20, 50, 100].filter((length) => length <= 0.3 * w).pop() ?? 1;
  const end = box[0] + box[2] - 0.3 * size;
  const foot = box[1] + box[3] - 0.5 * size;
  picture.append(
    svg('path', { class: 'scale', d: `M${end - bar} ${foot}h${bar}` }),
    svg('text', { x: end - bar / 2, y: foot - 0.4 * size, 'font-size': (0.85 * size).toFixed(2), 'text-anchor': 'middle' }, `${bar} mm`),
  );
  return { picture, width: box[2] };
}

export function slices() {
  const across = 1040; // pixels for the three together, about
  const total = data.slices.reduce((sum, one) => sum + one.width_mm, 0);
  const pixelsPerMm = across / (1.15 * total);
  const row = element('div', { class: 'planes' });
  for (const one of data.slices) {
    const { picture, width } = slice(one, pixelsPerMm);
    row.append(element('figure', { style: `flex:${width.toFixed(1)} 1 0` }, picture, element('figcaption', {}, one.name)));
  }
  return row;
}
