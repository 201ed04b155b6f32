// Sections of the page, from the top: verdict, warnings, force, body, slices, and the choices of the run.
import { chartLegend, forceChart } from './chart.js';
import { body, canDraw } from './body.js';
import { at, baseName, data, element, facts, heat, number, place3, quantity, section, there, word, written } from './numbers.js';
import { loadRows, steps } from './loads.js';
import { furtherTools, walls } from './rigid.js';
import { assumedOfShift, head as headOfShift, shift, slicesOfShift } from './shift.js';
import { slices, taken, tintOf } from './slices.js';

const isShift = there('shift');
const isScene = there('largest_force');

// ------------------------------------------------------------------------------------------------------- head

function head() {
  const subject = there('image') ? at('image') : (at('made_from.image') ?? 'a model');
  document.title = `${baseName(subject)}: indentation`;
  const place = section('head');
  place.append(element('p', { class: 'subject' }, element('strong', {}, baseName(subject)), ', indented by Dimple ', word('version')));
  if (isScene)
    place.append(element('h1', {}, 'Largest force ', written('largest_force.force_N'), ', ', written('force_N'), ' at the end'),
      element('p', { class: 'band' }, 'The largest is at ', written('largest_force.indentation_mm'), ' and ', quantity('largest_force.time_s', 's'), ', in the step ', word('largest_force.step'), '.'));
  else place.append(element('h1', {}, written('force_N'), ' at ', written('indentation_mm')));
  if (there('band.half_N') && isScene)
    place.append(element('p', { class: 'band' }, 'The true forces are expected within ± ', written('band.half_N'), ' of these (discretisation error only).'));
  else if (there('band.low_N'))
    place.append(element('p', { class: 'band' }, 'The true value is expected between ', written('band.low_N', false), ' and ', written('band.high_N'), ' (discretisation error only).'));
  else if (there('band.unknown')) place.append(element('p', { class: 'band' }, 'No error estimate: ', word('band.unknown')));
  if (there('image_error.half_N'))
    place.append(element('p', { class: 'band' }, 'The image resolution adds ± ', written('image_error.half_N'), '.'));
  if (there('band_of_mu.low_N'))
    place.append(element('p', { class: 'band' }, 'Between ', written('band_of_mu.low_N', false), ' and ', written('band_of_mu.high_N'), ' for the range of the modulus.'));
}

// ---------------------------------------------------------------------------------------------------- verdict

const questions = { image: 'Image', model: 'Model', equilibrium: 'Equilibrium', energy: 'Energy', accuracy: 'Accuracy' };

function verdict() {
  const strip = element('ul', { class: 'verdict' });
  for (const [key, question] of Object.entries(questions)) {
    const answer = `verdict.${key}`;
    const card = element('li', { class: at(`${answer}.word`) }, element('h3', {}, question));
    card.append(element('p', { class: 'word' }, word(`${answer}.word`)));
    card.append(element('p', { class: 'figure' }, ...[at(`${answer}.unit`) === '%' ? written(`${answer}.value`) : [number(`${answer}.value`, { decimals: 0 }), ' ', word(`${answer}.unit`)]].flat()));
    card.append(element('p', { class: 'of' }, word(`${answer}.of`)));
    for (const k of (at(`${answer}.reasons`) ?? []).keys()) card.append(element('p', { class: 'reason' }, word(`${answer}.reasons.${k}`)));
    strip.append(card);
  }
  section('verdict').append(strip);
}

function warnings() {
  const place = section('warnings');
  if (there('failure'))
    place.append(
      element('div', { class: at('status') === 'failed' ? 'note bad' : 'note check' },
        element('p', {}, element('strong', {}, at('status') === 'failed' ? 'The run failed. ' : 'The run was interrupted. '), word('failure.fact'), '; ', word('failure.where')),
        element('p', {}, word('failure.why'), '. ', element('strong', {}, 'Remedy: '), word('failure.remedy'))));
  const list = at('warnings') ?? [];
  if (list.length > 0) place.append(element('h2', {}, list.length === 1 ? '1 warning' : `${list.length} warnings`));
  for (const k of list.keys()) place.append(element('p', { class: 'note check' }, word(`warnings.${k}`)));
  const retries = at('retries') ?? [];
  for (const k of retries.keys())
    place.append(element('p', { class: 'note plain' }, 'Repeated at ', written(`retries.${k}.at_mm`), ' (', word(`retries.${k}.code`), '): ', word(`retries.${k}.what`)));
  if (list.length === 0 && retries.length === 0 && !there('failure')) place.append(element('p', { class: 'note plain' }, 'There were no warnings.'));
}

// ------------------------------------------------------------------------------------------------------ force

function forceSection() {
  const place = section('force');
  if (isScene) place.querySelector('h2').textContent = 'Force over time';
  const rows = [
    isScene && ['largest force on the tool', written('largest_force.force_N'), ', in the step ', word('largest_force.step')],
    [isScene ? 'force on the tool at the end' : 'force on the tool', written('force_N')],
    ['force on the base', written('base_force_N')],
    there('band.half_N') && ['discretisation error', '± ', written('band.half_N'), ', estimated from ', number('counts.nodes', { decimals: 0 }), ' and from ', number('band.coarser_nodes', { decimals: 0 }), ' nodes'],
    there('band.unknown') && ['discretisation error', 'unknown: ', word('band.unknown')],
    there('image_error.half_N') && ['image resolution error', '± ', written('image_error.half_N'), ', with voxels of ', written('image_error.voxel_mm'), ' along the approach direction'],
    there('image_error.unknown') && ['image resolution error', 'unknown: ', word('image_error.unknown')],
    [isScene ? 'indentation at the end' : 'indentation', written('indentation_mm'), isScene ? '' : [' of ', written('requested.depth_mm')]],
  ];
  const table = facts(rows);
  const words = element('div', {}, table);
  if (there('other_tools')) words.append(element('h3', {}, 'Further tools at the end'), furtherTools());
  if (there('walls')) words.append(element('h3', {}, 'Walls at the end'), walls());
  if (there('compare.file')) words.append(element('h3', {}, 'Comparison with ', word('compare.file')), comparison());
  if (there('ladder')) words.append(element('h3', {}, 'Refinement levels'), ladder());
  place.append(element('div', { class: 'beside' }, element('div', {}, forceChart(), chartLegend()), words));
  if (isScene) place.append(element('h3', {}, 'Steps'), steps());
}

function comparison() {
  if (!there('compare.ratio_at_end')) return element('p', {}, 'The two curves have no depth in common.');
  const named = (at('compare.values') ?? []).map((value, k) => [value.name, written(`compare.values.${k}.force_N`), ', ', number(`compare.values.${k}.ratio`, { decimals: 2 }), ' of ours']);
  return facts([
    ...named,
    named.length === 0 && ['measured / ours at the end', number('compare.ratio_at_end', { decimals: 2 }), ', at ', written('compare.depth_mm')],
    named.length === 0 && ['on average', number('compare.mean_ratio', { decimals: 2 }), ', over ', number('compare.rows', { decimals: 0 }), ' depths'],
    named.length === 0 && ['root mean square difference', written('compare.rms_N')],
    there('compare.inside_band') && ['within the error bounds', quantity('compare.inside_band', '%', { scale: 100, decimals: 0 }), ' of the rows'],
    at('compare.deeper_rows') > 0 && ['not compared', number('compare.deeper_rows', { decimals: 0 }), ' rows deeper than this run'],
  ]);
}

function ladder() {
  const table = element('table', { class: 'list' }, element('tr', {}, ...['nodes', 'force', 'error, ±', 's'].map((name) => element('th', { scope: 'col' }, name))));
  for (const k of at('ladder').keys()) {
    const step = `ladder.${k}`;
    table.append(element('tr', {}, element('td', {}, number(`${step}.nodes`, { decimals: 0 })), element('td', {}, written(`${step}.force_N`)),
      element('td', {}, there(`${step}.half_N`) ? written(`${step}.half_N`) : '–'), element('td', {}, number(`${step}.wall_s`, { decimals: 1 }))));
  }
  return table;
}

// ------------------------------------------------------------------------------------------------------- body

function bodySection() {
  const place = section('body');
  if (!data.body && !data.picture) return place.append(element('p', {}, 'No frame was kept of this run.'));
  if (data.picture) place.append(element('img', { class: 'drawn', src: data.picture, alt: 'the deformed body with the tool, coloured by displacement' }));
  if (!canDraw()) {
    document.documentElement.classList.add('flat');
    const why = data.body ? 'This browser has no WebGL: a picture is shown instead of the 3D view.' : '';
    if (!data.picture) place.append(element('p', {}, `${why} The run was ended before it drew one.`));
    else if (why) place.append(element('p', { class: 'soft screen' }, why));
    return undefined;
  }
  const view = element('div', { class: 'view3d' });
  const play = element('button', { type: 'button' }, 'Play');
  const slider = element('input', { type: 'range', min: 0, max: data.body.frames.length - 1, value: data.body.frames.length - 1, 'aria-label': 'indentation' });
  const depth = element('output', {});
  const again = element('button', { type: 'button' }, 'Reset view');
  const stage = element('div', { class: 'stage' }, view);
  place.append(stage, element('div', { class: 'controls' }, play, slider, depth, again), element('p', { class: 'soft screen' }, 'Drag to turn, Shift and drag to move, Ctrl and wheel to zoom.'));
  let shown;
  try {
    shown = body(view);
  } catch (problem) {
    document.documentElement.classList.add('flat');
    for (const made of place.querySelectorAll('.stage, .controls, .screen')) made.remove();
    place.append(element('p', { class: 'soft' }, `The body cannot be shown in 3D here: ${problem.message}`));
    return undefined;
  }
  stage.append(colourBar(shown.most));
  stage.after(element('ul', { class: 'legend screen' }, element('li', {}, element('span', { class: 'mark tool' }), ...(isShift ? ['where the skull is open'] : toolWords()))));
  const show = (k) => {
    slider.value = k;
    depth.textContent = isShift ? (k === 0 ? 'at rest' : 'after it') : `${shown.depths[k].toFixed(2)} mm`;
    shown.show(k);
  };
  let timer = 0;
  const stop = () => {
    clearInterval(timer);
    timer = 0;
    play.textContent = 'Play';
  };
  play.addEventListener('click', () => {
    if (timer) return stop();
    play.textContent = 'Pause';
    let k = Number(slider.value) % (shown.depths.length - 1);
    const pace = Math.max(2400 / shown.depths.length, 60);
    timer = setInterval(() => {
      show(k);
      if (++k === shown.depths.length) stop();
    }, pace);
    return undefined;
  });
  slider.addEventListener('input', () => (stop(), show(Number(slider.value))));
  again.addEventListener('click', shown.reset);
  show(shown.depths.length - 1);
  return undefined;
}

function colourBar(most) {
  const bar = element('div', { class: 'colours', 'aria-label': 'displacement in mm' });
  const step = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20].find((s) => most / s <= 5) ?? 50;
  bar.append(element('span', { class: 'title' }, 'displacement, mm'), element('div', { class: 'ramp', style: `background:linear-gradient(to top,${heat.join(',')})` }));
  for (let value = 0; value <= most * 1.0001; value += step) bar.append(element('span', { class: 'tick', style: `bottom:${(100 * value) / most}%` }, String(Number(value.toFixed(2)))));
  return bar;
}

// ----------------------------------------------------------------------------------------------------- slices

function sliceSection() {
  const place = section('slices');
  if (data.slices.length === 0) return place.remove();
  const entry = (mark, text) => element('li', {}, element('span', { class: `mark ${mark}` }), text);
  const legend = element('ul', { class: 'legend' });
  for (const k of (at('labels') ?? []).keys()) {
    const label = at(`labels.${k}`);
    if (k < 8) legend.append(element('li', {}, element('span', { class: 'mark tint', style: `background:${tintOf(label.value)}` }), label.name ? `${label.value} ${label.name}` : `label ${label.value}`));
  }
  if (taken.length > 8) legend.append(element('li', {}, `and ${taken.length - 8} more labels`));
  legend.append(entry('node', 'node'), entry('node base', 'fixed base'), ...(there('counts.circle_nodes') ? [entry('node circle', 'contact patch')] : []), entry('outline', 'outline at rest'), entry('outline moved', 'at the end'), entry('tool', isShift ? 'where the skull is open' : 'tool at the end'));
  if (data.slices.some((one) => (one.walls ?? []).length > 0)) legend.append(entry('wall', isShift ? 'skull' : 'wall'));
  place.append(slices(), legend);
  const tilt = data.tilt_degrees > 1 ? ` The image's axes are rotated by ${data.tilt_degrees} degrees against the patient's; the letters name the nearest.` : '';
  place.append(element('p', { class: 'soft' }, `Sagittal, coronal and axial sections through ${isShift ? 'a point below the opening' : "the midpoint of the tool's path"} (radiological convention: the patient's right is on the left). Nodes at rest within ${(data.slab_mm / 2).toFixed(1)} mm of the plane; the ${isShift ? 'opening' : 'tool'} is seen along it.${tilt}`));
  return undefined;
}

// ---------------------------------------------------------------------------------------------------- assumed

function toolWords() {
  return there('tool.words') ? ['tool: ', word('tool.words')] : ['tool, ', written('counts.circle_diameter_mm'), ' in diameter'];
}

function cutWords() {
  const words = [];
  if (at('model.cut.area_mm2') > 0) words.push(quantity('model.cut.area_mm2', 'mm²', { decimals: 0 }), ' on each face');
  if (at('model.cut.removed_mm3') > 0) words.push(words.length > 0 ? '; ' : '', written('model.cut.removed_mm3'), ' of tissue removed');
  for (const k of at('model.cut.labels_taken_out').keys()) words.push(words.length > 0 ? '; ' : '', 'removed: ', at(`model.cut.labels_taken_out.${k}.name`) ? word(`model.cut.labels_taken_out.${k}.name`) : 'a label', ', ', written(`model.cut.labels_taken_out.${k}.volume_mm3`));
  for (const k of at('model.cut.parted').keys()) words.push('; separated and left out: ', written(`model.cut.parted.${k}.volume_mm3`));
  return words;
}

function labelList() {
  const table = element('table', { class: 'list' });
  const most = 30;
  for (const k of at('labels').keys()) {
    if (k === most) break;
    const label = `labels.${k}`;
    table.append(element('tr', {}, element('td', {}, number(`${label}.value`, { decimals: 0 })), element('td', { class: 'text' }, at(`${label}.name`) ? word(`${label}.name`) : ''), element('td', {}, written(`${label}.volume_mm3`)), element('td', {}, quantity(`${label}.voxels`, 'voxels', { decimals: 0 }))));
  }
  if (at('labels').length > most) table.append(element('tr', {}, element('td', { colspan: 4, class: 'text' }, `and ${at('labels').length - most} more`)));
  return table;
}

function materials() {
  return at('material').map((material, k) => {
    const one = `material.${k}`;
    const line = element('div', {}, at('material').length > 1 ? element('strong', {}, 'label ', word(`${one}.label`), ': ') : '', word(`${one}.law`), ', mu ', written(`${one}.mu_Pa`), ', nu ', number(`${one}.nu`, { digits: 4 }), ', density ', quantity(`${one}.density_kg_per_m3`, 'kg/m³', { decimals: 0 }));
    if (material.default) line.append(element('div', { class: 'soft' }, 'swine brain (Horton et al. 2007), as no material was given'));
    return line;
  });
}

function assumed() {
  const reason = (key) => there(key) && element('div', { class: 'soft' }, word(key));
  section('assumed').append(
    facts([
      there('image') && ['Image', word('image'), reason('image_read_as')],
      there('labels') && ['Labels', labelList()],
      there('model.organ_volume_mm3') && ['Body', written('model.organ_volume_mm3'), ', ', quantity('model.pieces', at('model.pieces') === 1 ? 'piece' : 'pieces', { decimals: 0 }), at('model.pieces') > 1 ? [', of which the largest was kept and ', written('model.dropped_volume_mm3'), ' dropped'] : '',
        at('model.closed_volume_mm3') > 0 ? [', ', written('model.closed_volume_mm3'), ' added by closing gaps'] : '',
        element('div', { class: 'soft' }, 'surface of triangles of ', written('model.surface_step_mm'), ', smoothed by ', written('model.smoothing_mm'))],
      ['Material', ...materials()],
      ...(isShift ? assumedOfShift() : []),
      ['Base', number('counts.base_nodes', { decimals: 0 }), ' nodes held', reason('model.base_reason'), reason('made_from.base')],
      there('model.cut') && (at('model.cut.area_mm2') > 0 || at('model.cut.removed_mm3') > 0 || at('model.cut.labels_taken_out').length > 0) && ['Cut', ...cutWords()],
      !isShift && (there('tool.words')
        ? ['Tool', word('tool.words'), ', its tip at first contact at ', place3('tool.first_touch_mm'), ' mm, approach direction ', place3('counts.push'), reason('model.circle_reason')]
        : ['Tool', written('counts.circle_diameter_mm'), ' in diameter, on ', number('counts.circle_nodes', { decimals: 0 }), ' nodes at ', place3('counts.circle_centre_mm'), ' mm, approach direction ', place3('counts.push'), reason('model.circle_reason'), reason('made_from.circle')]),
      there('tool.contact_area_mm2') && ['Contact', quantity('tool.contact_area_mm2', 'mm²', { decimals: 1 }), ' at the end, on ', number('tool.samples_in_contact', { decimals: 0 }), ' contact points; largest pressure ', written('tool.largest_pressure_Pa'), '; between them the surface penetrates by ', written('tool.largest_penetration_mm'), ' at most'],
      !isShift && ['Load', isScene ? 'in the steps above' : [written('requested.depth_mm'), ' at ', quantity('requested.rate_mm_per_s', 'mm/s')], ', ', word('contact'), ', ', word('time')],
      ...(isShift ? [] : loadRows()),
      ['Discretisation', number('counts.nodes', { decimals: 0 }), ' nodes', there('model.largest_spacing_mm') ? [': ', written('model.rim_spacing_mm'), ` apart at the ${isShift ? 'opening' : 'tool'}, `, written('model.largest_spacing_mm'), ' far from it'] : '', '; ', number('counts.integration_points', { decimals: 0 }), ' integration points',
        element('div', { class: 'soft' }, 'scheme ', word('scheme'), ', ', word('precision'), ' precision')],
    ], 'facts broad'),
    element('p', { class: 'soft' }, 'Places are in mm along left, posterior and superior (LPS).'));
}

// ------------------------------------------------------------------------------------------------------ times

function times() {
  const parts = Object.keys(at('parts_wall_s') ?? {});
  const bar = element('div', { class: 'bar', 'aria-hidden': 'true' });
  const table = element('table', { class: 'list times' });
  parts.forEach((name, k) => {
    const key = `parts_wall_s.${name}`;
    bar.append(element('span', { class: `part p${k}`, style: `width:${(100 * at(key)) / Math.max(at('total_wall_s'), 1e-9)}%` }));
    table.append(element('tr', {}, element('td', { class: 'text' }, element('span', { class: `mark part p${k}` }), name), element('td', {}, quantity(key, 's', { decimals: 2 }))));
  });
  table.append(element('tr', { class: 'sum' }, element('td', { class: 'text' }, 'in all, with ', number('threads', { decimals: 0 }), at('threads') === 1 ? ' thread' : ' threads'), element('td', {}, quantity('total_wall_s', 's', { decimals: 2 }))));
  section('times').append(bar, table);
  if (there('force_evaluations')) section('times').append(element('p', { class: 'soft' }, number('force_evaluations', { decimals: 0 }), ' force evaluations, ', quantity('ms_per_step', 'ms', { decimals: 2 }), ' each.'));
}

// ---------------------------------------------------------------------------------------------- again and cite

function copied(text, css = '') {
  const button = element('button', { type: 'button', class: 'copy' }, 'Copy');
  const shown = element('pre', { class: css, tabindex: 0 }, text);
  button.addEventListener('click', async () => {
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = 'Copied';
    } catch { // a page from the disk may lack the permission
      getSelection().selectAllChildren(shown);
      button.textContent = document.execCommand('copy') ? 'Copied' : 'Selected';
    }
    setTimeout(() => (button.textContent = 'Copy'), 1500);
  });
  return element('div', { class: 'copied' }, button, shown);
}

function again() {
  const place = section('again');
  place.append(data.command ? copied(data.command) : element('p', {}, 'The image of this run was in memory: give it again, with the options below.'));
  const hash = there('image_sha256') ? 'image_sha256' : 'model_sha256';
  place.append(element('p', { class: 'soft' }, there('image') ? 'The image has the SHA-256 ' : 'The model has the SHA-256 ', element('code', {}, word(hash)), '. With the file below, stored next to this page, the same version of the program gives the same bits.'));
  place.append(element('h3', {}, 'config.resolved.toml'), copied(data.options, 'long'));
}

function cite() {
  const software = `@software{dimple,
  title   = {Dimple: from a label image to a force, meshless soft-tissue indentation},
  author  = {{The Dimple authors}},
  version = {${at('version')}}
}`;
  const paper = `@inproceedings{horton2007,
  title     = {Subject-Specific Biomechanical Simulation of Brain Indentation Using a Meshless Method},
  author    = {Horton, Ashley and Wittek, Adam and Miller, Karol},
  booktitle = {Medical Image Computing and Computer-Assisted Intervention (MICCAI)},
  year      = {2007}
}`;
  section('cite').append(element('p', {}, 'The software, and the paper that its method grew from:'), copied(`${software}\n\n${paper}\n`));
}

function depends() {
  const place = section('depends');
  if (place.querySelector('svg')) return;
  place.append(element('p', {}, 'This was not measured. ', element('code', {}, `dimple ${isShift ? 'shift' : 'run'} … --explain`), ' repeats the run with one choice changed at a time and adds a chart of the effects here.'));
}

const indentation = [head, verdict, warnings, forceSection, bodySection, sliceSection];
const craniotomy = [headOfShift, warnings, shift, bodySection, sliceSection, slicesOfShift];
for (const part of [...(isShift ? craniotomy : indentation), depends, assumed, times, again, cite]) {
  try {
    part();
  } catch (problem) { // a failure of one section does not affect the others
    document.querySelector('main').append(element('p', { class: 'note bad', 'data-problem': part.name }, `A part of this page could not be drawn: ${problem.message}`));
  }
}
document.documentElement.classList.add('ready');
