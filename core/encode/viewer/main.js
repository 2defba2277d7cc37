// The program of a .html result.
import {mountViewer, payloadOf} from './viewer.js';

const page = document.getElementById('viewer');
try {
  const payload = await payloadOf(document.getElementById('voxels').outerHTML);
  window.viewer = mountViewer(page, payload);
  // #view=AZIMUTH,ELEVATION, as --view has them.
  const view = /view=(-?[\d.]+),(-?[\d.]+)/.exec(location.hash);
  if (view) window.viewer.setView(Number(view[1]), Number(view[2]));
  page.dataset.state = 'ready';
} catch (error) {
  page.dataset.state = 'failed';
  page.textContent = `The voxels cannot be shown: ${error.message}.`;
}
