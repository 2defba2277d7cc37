// The options of the form: rows of targets, what goes together, the spec that they make, errors at their fields.
import {blendsOf, encodingsOf, fillsOf, MAX_TARGETS, shownText} from './rules.js';

const COLOURS = {shader: 'base_color', format: 'VOXEL_FORMAT_U8', blend: 'BLEND_REPLACE', encoding: 'ENCODING_SRGB'};
const NORMALS = {shader: 'normal', format: 'VOXEL_FORMAT_F32', blend: 'BLEND_AVERAGE', encoding: 'ENCODING_LINEAR'};
const PARTS = ['shader', 'format', 'blend', 'encoding'];
const $ = (id) => document.getElementById(id);
// The last word of an enum's value: "cpu" of BACKEND_CPU.
export const wordOf = (value) => `${value}`.split('_').pop().toLowerCase();

export class Options {
  #form;
  #shaders = new Map();

  // In: the form, whose `change` events are those of the options.
  constructor(form) {
    this.#form = form;
    form.addEventListener('change', (event) => this.#settle(event.target));
    for (const by of ['size', 'resolution']) {
      $(by).addEventListener('input', () => { form.elements.by.value = by; });
    }
    $('add').addEventListener('click', () => {
      const row = this.#add(this.#rows().length === 0 ? COLOURS : NORMALS);
      row.querySelector('[name="shader"]').focus();
      this.#changed();
    });
    this.#settle(null);
  }

  // In: the ShaderInfo of each shader of the server. Rows keep what they have chosen.
  setShaders(list) {
    this.#shaders = new Map(list.filter(({stage}) => wordOf(stage) === 'fragment').map((info) => [info.name, info]));
    $('add').disabled = false;
    for (const row of this.#rows()) {
      this.#offerShaders(row.querySelector('[name="shader"]'));
      this.#settleTarget(row, null);
    }
  }

  // A VoxelizeSpec of what is chosen. Without targets each format of files has its own.
  spec() {
    const bySize = this.#form.elements.by.value === 'size';
    const size = Number($('size').value);
    const resolution = Math.max(0, Math.round(Number($('resolution').value)));
    const grid = bySize ? {voxel_size: {x: size, y: size, z: size}} : {resolution: {voxels: resolution}};
    const scope = $('parts').value;
    const parts = scope === 'PART_SCOPE_WHOLE' ? {} : {parts: {scope}};
    return {grid, coverage: $('coverage').value, fill: $('fill').value, ...parts, targets: this.#rows().map(targetOf)};
  }

  // Shows the errors of the server, [{field, description}], at the fields that they name, in place of earlier ones.
  // Out: the first such field, or null.
  mark(violations) {
    for (const note of this.#form.querySelectorAll('.wrong')) note.remove();
    for (const field of this.#form.querySelectorAll('[aria-invalid]')) {
      field.removeAttribute('aria-invalid');
      field.removeAttribute('aria-errormessage');
    }
    let first = null;
    for (const [n, {field, description}] of violations.entries()) {
      const element = this.#fieldOf(field);
      if (!element) continue;
      const note = document.createElement('p');
      note.className = 'wrong';
      note.id = `wrong-${n}`;
      note.textContent = description;
      (element.closest('label') ?? element).after(note);
      element.setAttribute('aria-invalid', 'true');
      element.setAttribute('aria-errormessage', note.id);
      first ??= element;
    }
    if (first && $('options').contains(first)) $('options').open = true;
    return first;
  }

  // "targets[0].shader.parameters" is a part of "targets[0].shader".
  #fieldOf(name) {
    for (let end = name.length; end > 0; end = name.slice(0, end).lastIndexOf('.')) {
      const element = this.#form.querySelector(`[data-field="${CSS.escape(name.slice(0, end))}"]`);
      if (element) return element;
    }
    return null;
  }

  #rows() {
    return [...$('targets').children];
  }

  #changed() {
    $('targets').dispatchEvent(new Event('change', {bubbles: true}));
  }

  #add(target) {
    const row = $('target').content.firstElementChild.cloneNode(true);
    $('targets').append(row);
    this.#offerShaders(row.querySelector('[name="shader"]'));
    for (const part of PARTS) row.querySelector(`[name="${part}"]`).value = target[part];
    this.#settleTarget(row, null);
    this.#describe(row);
    row.querySelector('button').addEventListener('click', () => {
      row.remove();
      $('add').disabled = false; // or it takes no focus
      $('add').focus();
      this.#changed();
    });
    return row;
  }

  #offerShaders(select) {
    const chosen = select.value;
    select.replaceChildren(...[...this.#shaders.keys()].map((name) => new Option(name, name)));
    if (this.#shaders.has(chosen)) select.value = chosen;
  }

  // Options that no longer go with the one that has changed give way.
  #settle(changed) {
    const fills = fillsOf($('coverage').value, $('parts').value);
    offer($('fill'), fills, fills[0]);
    $('coverage-about').hidden = $('coverage').value !== 'COVERAGE_NONE';
    const row = changed?.closest('.target');
    if (row) this.#settleTarget(row, changed.name);
    if (row && changed.name === 'shader') this.#describe(row);
    this.#rows().forEach((one, n) => {
      one.querySelector('legend').textContent = `Target ${n}`;
      one.querySelector('button').setAttribute('aria-label', `Remove target ${n}`);
      for (const part of PARTS) one.querySelector(`[name="${part}"]`).dataset.field = `targets[${n}].${part}`;
    });
    $('add').disabled = this.#shaders.size === 0 || this.#rows().length >= MAX_TARGETS;
    $('shown').textContent = shownText(this.spec());
  }

  #settleTarget(row, changed) {
    const [shader, format, blend, encoding] = PARTS.map((part) => row.querySelector(`[name="${part}"]`));
    const blends = blendsOf(format.value);
    offer(blend, blends, blends[0]);
    const encodings = encodingsOf({shader: shader.value, format: format.value, blend: blend.value});
    offer(encoding, encodings, encodings[0]);
    // Of the values in a new format, or of another shader, as much as possible.
    if (changed === 'shader' || changed === 'format') [encoding.value] = encodings;
  }

  // What the shader gives, and a field for each of its parameters.
  #describe(row) {
    const info = this.#shaders.get(row.querySelector('[name="shader"]').value);
    row.querySelector('.about').textContent =
      info ? `${info.description} (${wordOf(info.output_type)} x ${info.output_components})` : '';
    row.querySelector('.parameters').replaceChildren(...(info?.parameters ?? []).map((parameter) => {
      const label = document.createElement('label');
      const input = document.createElement('input');
      input.dataset.parameter = parameter.name;
      input.dataset.type = wordOf(parameter.type);
      input.placeholder = parameter.default_values.join(' ');
      label.title = parameter.description;
      label.append(`${parameter.name} `, input);
      return label;
    }));
  }
}

// In: a <select>, the values that can be chosen, and the one in place of a chosen one that cannot.
function offer(select, values, otherwise) {
  for (const option of select.options) option.disabled = !values.includes(option.value);
  if (!values.includes(select.value)) select.value = otherwise;
}

// A RenderTarget of a row.
function targetOf(row) {
  const [name, format, blend, encoding] = PARTS.map((part) => row.querySelector(`[name="${part}"]`).value);
  const given = [...row.querySelectorAll('[data-parameter]')].filter((input) => input.value.trim() !== '');
  const parameters = given.map(({dataset, value}) => ({
    name: dataset.parameter,
    ...(dataset.type === 'string' ? {text: value} : {numbers: {values: value.trim().split(/[\s,/]+/).map(Number)}}),
  }));
  return {format, blend, shader: {name, parameters}, encoding};
}
