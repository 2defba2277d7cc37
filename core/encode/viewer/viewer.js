// A viewer of voxels in an element of a page.
import {OrbitControls} from 'three/examples/jsm/controls/OrbitControls.js';

import {coloursOf, labelsOf, MAP} from './colours.js';
import {Frames} from './frames.js';
import {readPayload} from './payload.js';
import {CUT_COLOUR, HATCH_COLOUR, VoxelScene} from './scene.js';

export {payloadOf} from './payload.js';

const ISO = [45, 35.264389682754654];
const TURN_DEGREES = 10;
const MAX_LABELS = 500; // in the list: more make a page slow

function make(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

const hex = (rgb) => `#${rgb.toString(16).padStart(6, '0')}`;

// A line of the legend: a bar with this background, and texts.
function showKey(line, background, before, after) {
  const bar = make('span', {class: 'voxels-bar'});
  bar.style.background = background;
  line.replaceChildren(before, bar, after);
}

const short = (number) => String(Number(number.toPrecision(6)));

// The world position of a cell's centre.
function centreOf(data, cell) {
  return data.origin.map((origin, axis) => origin + (cell[axis] + 0.5) * data.voxel_size[axis]);
}

function describe(data, labels, {cell, voxel}) {
  // A coarse voxel stands for several of the grid.
  const index = cell.map((i) => (data.step === 1 ? i : `${i * data.step}-${i * data.step + data.step - 1}`));
  const parts = [`voxel ${index.join(', ')}`, `at ${centreOf(data, cell).map(short).join(', ')}`];
  if (voxel < 0) return [...parts, 'inside'].join(' · ');
  for (const target of data.targets) {
    const from = voxel * target.components;
    const values = Array.from(target.values.subarray(from, from + target.components));
    const name = target.shows === 'label' ? labels.get(values[0])?.name : '';
    parts.push(`${target.name} ${values.map(short).join(', ')}${name ? ` (${name})` : ''}`);
  }
  return parts.join(' · ');
}

// What the list says of a label, after its colour.
function labelText({label, name, parts, triangles, voxels}) {
  const count = (number, word) => `${number.toLocaleString('en')} ${word}${number === 1 ? '' : 's'}`;
  const facts = [count(triangles, 'triangle')];
  if (voxels !== undefined) facts.push(count(voxels, 'voxel'));
  if (parts > 1) facts.unshift(count(parts, 'part'));
  return `${label}${name ? ` ${name}` : ''}: ${facts.join(', ')}`;
}

// The parts by label, with their colours. `data-labels` counts them for tests.
function labelList(labels) {
  const list = make('ul', {class: 'voxels-labels', 'data-labels': labels.size});
  for (const entry of [...labels.values()].slice(0, MAX_LABELS)) {
    const bar = make('span', {class: 'voxels-bar'});
    bar.style.background = hex(entry.colour);
    list.append(make('li', {}, bar, make('span', {}, labelText(entry))));
  }
  if (labels.size > MAX_LABELS) list.append(make('li', {}, `and ${labels.size - MAX_LABELS} more`));
  return make('details', {class: 'voxels-parts', open: ''}, make('summary', {}, 'Parts'), list);
}

function sliceControl(data, axis, change) {
  const name = 'xyz'[axis];
  const size = data.dims[axis];
  const from = make('input', {type: 'range', min: 0, max: size - 1, value: 0, 'aria-label': `first ${name} shown`});
  const to = make('input', {type: 'range', min: 1, max: size, value: size, 'aria-label': `${name} shown up to`});
  const shown = make('output');
  const update = () => {
    shown.textContent = `${Number(from.value) * data.step} to ${Number(to.value) * data.step - 1}`;
    change(axis, Number(from.value), Number(to.value));
  };
  from.addEventListener('input', update);
  to.addEventListener('input', update);
  shown.textContent = `0 to ${size * data.step - 1}`;
  return make('fieldset', {}, make('legend', {}, name, ' ', shown), from, to);
}

// In: an element of the page, and an inflated payload (payload.js). Fills the element. Out: `dispose()`, which empties
// it, and what tests need: `setView(azimuth, elevation)`, `pick(x, y)` (a text, empty if nothing is there), `still()`
// (a promise of the sharp frame), and `frameMs(ratio)` at this number of pixels for one of CSS, each way. Throws an
// Error if the browser has no WebGL 2.
export function mountViewer(element, payload) {
  const data = readPayload(payload);
  const keys = 'arrow keys turn, + and - zoom, R resets the view';
  const canvas = make('canvas', {tabindex: 0, role: 'img', 'aria-label': `Voxels; ${keys}`});
  const stage = make('div', {class: 'voxels-stage'}, canvas);
  const voxelScene = new VoxelScene(canvas, data);
  const controls = new OrbitControls(voxelScene.camera, canvas);

  const frames = new Frames(voxelScene);
  const draw = () => frames.draw();
  controls.addEventListener('change', draw);

  let angles = ISO;
  const setView = (azimuth, elevation) => {
    angles = [azimuth, elevation];
    controls.target.copy(voxelScene.setView(azimuth, elevation));
    controls.update();
    voxelScene.camera.updateProjectionMatrix();
    draw();
  };

  const labels = labelsOf(data);
  const parts = labelList(labels);
  parts.hidden = labels.size === 0;
  const legend = make('p', {class: 'voxels-legend'});
  const showTarget = (number) => {
    const target = number < 0 ? null : data.targets[number];
    const {rgba, range} = coloursOf(target, data.voxels, labels);
    voxelScene.setColours(rgba);
    legend.hidden = range === null;
    parts.classList.toggle('voxels-shown', target?.shows === 'label');
    if (range) showKey(legend, `linear-gradient(90deg, ${MAP.map(hex).join(', ')})`, ...range.map(short));
    draw();
  };
  const cutLegend = make('p', {class: 'voxels-legend voxels-cut', hidden: ''});
  const [cut, line] = [CUT_COLOUR, HATCH_COLOUR].map(hex);
  showKey(cutLegend, `repeating-linear-gradient(45deg, ${line} 0 1px, ${cut} 1px 6px)`, '', 'inside of a solid, cut');
  const choice = make('select', {'aria-label': 'Colour by'});
  data.targets.forEach(({name, title}, number) => choice.append(make('option', {value: number}, `${name}: ${title}`)));
  choice.append(make('option', {value: -1}, 'one colour'));
  choice.addEventListener('change', () => showTarget(Number(choice.value)));

  const found = make('p', {class: 'voxels-found', role: 'status'}, 'Point at a voxel to read it.');
  const pick = (x, y) => {
    const found = voxelScene.pick(x, y);
    return found ? describe(data, labels, found) : '';
  };
  let timer = 0;
  canvas.addEventListener('pointermove', (event) => {
    clearTimeout(timer);
    if (event.buttons !== 0) return;
    timer = setTimeout(() => {
      const text = pick(event.offsetX, event.offsetY);
      if (text) found.textContent = text;
    }, 60);
  });
  canvas.addEventListener('keydown', (event) => {
    const turns = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1]}[event.key];
    if (turns) {
      const elevation = Math.min(Math.max(angles[1] + TURN_DEGREES * turns[1], -90), 90);
      setView(angles[0] + TURN_DEGREES * turns[0], elevation);
    } else if (event.key === '+' || event.key === '-') {
      voxelScene.camera.zoom *= event.key === '+' ? 1.2 : 1 / 1.2;
      voxelScene.camera.updateProjectionMatrix();
      draw();
    } else if (event.key === 'r' || event.key === 'R') {
      setView(...ISO);
    } else {
      return;
    }
    event.preventDefault();
  });

  const facts = make('p', {class: 'voxels-facts'}, data.title);
  const panel = make('div', {class: 'voxels-panel'}, facts, make('label', {}, 'Colour by ', choice), legend, cutLegend,
    parts,
    ...[0, 1, 2].map((axis) => sliceControl(data, axis, (...slice) => {
      voxelScene.setSlice(...slice);
      cutLegend.hidden = !voxelScene.cutsInside;
      draw();
    })), found);
  if (data.step > 1) {
    const faces = data.whole_faces.toLocaleString('en');
    facts.after(make('p', {class: 'voxels-note'},
      `Shown at 1/${data.step} of the resolution: ${faces} faces are too many for a page.`));
  }
  element.classList.add('voxels');
  element.replaceChildren(stage, panel);

  const resize = () => {
    voxelScene.resize(Math.max(stage.clientWidth, 1), Math.max(stage.clientHeight, 1));
    draw();
  };
  const observer = new ResizeObserver(resize);
  observer.observe(stage);
  resize();
  setView(...ISO);
  const first = data.targets.findIndex((target) => target.shows !== 'number');
  choice.value = String(first >= 0 ? first : data.targets.length > 0 ? 0 : -1);
  showTarget(Number(choice.value));
  element.dataset.webgl = '2';
  element.dataset.faces = String(voxelScene.faces);

  return {
    setView,
    pick,
    still: () => frames.still(),
    frameMs(ratio) {
      const context = voxelScene.renderer.getContext();
      const begin = performance.now();
      voxelScene.render(ratio);
      context.readPixels(0, 0, 1, 1, context.RGBA, context.UNSIGNED_BYTE, new Uint8Array(4));  // waits for the frame
      return performance.now() - begin;
    },
    dispose() {
      observer.disconnect();
      frames.stop();
      controls.dispose();
      voxelScene.dispose();
      element.replaceChildren();
    },
  };
}
