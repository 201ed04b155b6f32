// Force curve. It is drawn without a chart library, which would be larger than the rest of the page.
import { scaleLinear } from 'd3-scale';
import { data, element, svg } from './numbers.js';

const width = 680;
const height = 400;
const plot = { left: 64, right: 18, top: 34, bottom: 50 };

// Axes with ticks, and the conversion of the plot's coordinates to pixels.
function axesOf(chart, xRange, yRange, xLabel, yLabel) {
  const x = scaleLinear(xRange, [plot.left, width - plot.right]);
  const y = scaleLinear(yRange, [height - plot.bottom, plot.top]);
  const axes = svg('g', { class: 'axes' });
  for (const value of x.ticks(6))
    axes.append(
      svg('line', { x1: x(value), x2: x(value), y1: plot.top, y2: height - plot.bottom }),
      svg('text', { x: x(value), y: height - plot.bottom + 20, 'text-anchor': 'middle' }, String(value)),
    );
  for (const value of y.ticks(5))
    axes.append(
      svg('line', { x1: plot.left, x2: width - plot.right, y1: y(value), y2: y(value) }),
      svg('text', { x: plot.left - 9, y: y(value) + 4.5, 'text-anchor': 'end' }, y.tickFormat(5)(value)),
    );
  axes.append(
    svg('line', { class: 'zero', x1: plot.left, x2: width - plot.right, y1: y(0), y2: y(0) }),
    svg('line', { class: 'zero', x1: plot.left, x2: plot.left, y1: plot.top, y2: height - plot.bottom }),
    svg('text', { x: (plot.left + width - plot.right) / 2, y: height - 8, 'text-anchor': 'middle' }, xLabel),
    svg('text', { x: 8, y: 16 }, yLabel),
  );
  chart.append(axes);
  return { px: (value) => x(value).toFixed(1), py: (value) => y(value).toFixed(1) };
}

const empty = (label) => svg('svg', { viewBox: `0 0 ${width} ${height}`, class: 'chart', role: 'img', 'aria-label': label });

/** Line through points. */
export function curveChart({ x, y, xLabel, yLabel }) {
  const chart = empty(`${yLabel} against ${xLabel}`);
  const { px, py } = axesOf(chart, [0, Math.max(...x, 1e-9) * 1.04], [0, Math.max(...y, 1e-9) * 1.1], xLabel, yLabel);
  if (x.length > 0) chart.append(svg('path', { class: 'curve', d: `M${x.map((value, k) => `${px(value)} ${py(y[k])}`).join('L')}` }));
  return chart;
}

export function forceChart() {
  const { force_N: force, low_N: low, high_N: high, lateral_N: lateral } = data.curve;
  const depth = data.curve.time_s ?? data.curve.depth_mm; // of a scene of steps, whose tool moves back or sideways
  const along = data.curve.time_s ? 'time in s' : 'indentation in mm';
  const beside = data.beside;
  const largest = Math.max(...force, ...high, ...(beside ? beside.force_N : []), ...(lateral ?? []), 1e-12);
  const least = Math.min(0, ...force, ...low);
  const unit = { unit: data.curve.unit, scale: data.curve.per_unit };
  const chart = empty(lateral ? 'force over time' : 'force against indentation');
  const deepest = Math.max(...depth, ...(beside ? beside.depth_mm : []), 1e-9) * 1.04;
  const { px, py: pixel } = axesOf(chart, [0, deepest], [least * unit.scale, largest * unit.scale * 1.1], along, `force in ${unit.unit}`);
  const py = (f) => pixel(f * unit.scale);

  const way = (points) => `M${points.map(([d, f]) => `${px(d)} ${py(f)}`).join('L')}`;
  const curve = depth.map((d, k) => [d, force[k]]);
  if (low.length > 0) {
    const upper = depth.map((d, k) => [d, high[k]]);
    const lower = depth.map((d, k) => [d, low[k]]).reverse();
    chart.append(svg('path', { class: 'band', d: `${way([...upper, ...lower])}Z` }));
  }
  if (curve.length > 0) chart.append(svg('path', { class: 'curve', d: way(curve) }));
  if (lateral) chart.append(svg('path', { class: 'lateral', d: way(depth.map((t, k) => [t, lateral[k]])) }));
  if (beside) {
    const dots = svg('g', { class: 'beside' });
    const size = beside.force_N.length > 40 ? 2.2 : 4;
    beside.depth_mm.forEach((d, k) => {
      const dot = svg('circle', { cx: px(d), cy: py(beside.force_N[k]), r: size });
      if (beside.rows.length > 0) dot.append(svg('title', {}, beside.rows[k]));
      dots.append(dot);
    });
    chart.append(dots);
  }
  if (curve.length > 0) {
    const [d, f] = curve[curve.length - 1];
    chart.append(svg('circle', { class: 'end', cx: px(d), cy: py(f), r: 5 }));
  }
  return chart;
}

/** Legend of the chart. */
export function chartLegend() {
  const entry = (mark, text) => element('li', {}, element('span', { class: `mark ${mark}` }), text);
  const list = element('ul', { class: 'legend' }, entry('curve', data.curve.lateral_N ? 'along the approach direction' : 'this run'));
  if (data.curve.lateral_N) list.append(entry('lateral', 'across the approach direction'));
  if (data.curve.low_N.length > 0) list.append(entry('band', 'discretisation error'));
  if (data.beside) {
    const name = data.beside.name === 'horton2007' ? 'Horton et al. 2007' : data.beside.name;
    list.append(entry('beside', data.beside.rows.length > 0 ? `${name}, in order of depth: ${data.beside.rows.join(', ')}` : name));
  }
  return list;
}
