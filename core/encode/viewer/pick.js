// The voxel under a point, by its ray.

// In: a read payload, a ray `from` + t * `along` in index space that begins outside the box, and the shown box of
// voxels [low, high). Out: the first solid voxel on the ray as {cell: [x, y, z], voxel}, `voxel` -1 for one inside a
// solid; null if there is none. Every listed voxel is tested: a few milliseconds for a million of them.
export function voxelOnRay({cells, voxels}, from, along, low, high) {
  const inverse = along.map((step) => 1 / (step || 1e-12));
  let [enter, leave] = [-Infinity, Infinity];
  for (let a = 0; a < 3; ++a) {
    const [t, u] = [(low[a] - from[a]) * inverse[a], (high[a] - from[a]) * inverse[a]];
    enter = Math.max(enter, Math.min(t, u));
    leave = Math.min(leave, Math.max(t, u));
  }
  if (!(enter < leave)) return null;
  // The voxel where the ray enters the box may be inside a solid. A nudge takes rounding off the border.
  const inside = enter + 1e-9 * Math.abs(leave);
  const entered = from.map((at, a) => Math.min(Math.max(Math.floor(at + inside * along[a]), low[a]), high[a] - 1));
  let before = -1; // the last voxel of the row that `entered` is in, up to it
  let [nearest, first] = [-1, Infinity];
  const [fromX, fromY, fromZ] = from, [overX, overY, overZ] = inverse; // lists are slow in the loop
  for (let n = 0; n < voxels; ++n) {
    const x = cells[4 * n], y = cells[4 * n + 1], z = cells[4 * n + 2];
    if (y === entered[1] && z === entered[2] && x <= entered[0]) before = n;
    if (x < low[0] || y < low[1] || z < low[2] || x >= high[0] || y >= high[1] || z >= high[2]) continue;
    const x0 = (x - fromX) * overX, x1 = (x + 1 - fromX) * overX;
    const y0 = (y - fromY) * overY, y1 = (y + 1 - fromY) * overY;
    const z0 = (z - fromZ) * overZ, z1 = (z + 1 - fromZ) * overZ;
    const near = Math.max(Math.min(x0, x1), Math.min(y0, y1), Math.min(z0, z1));
    if (near >= first) continue;
    if (near <= Math.min(Math.max(x0, x1), Math.max(y0, y1), Math.max(z0, z1))) [nearest, first] = [n, near];
  }
  if (before >= 0 && cells[4 * before] < entered[0] && (cells[4 * before + 3] & 2) === 0) {
    return {cell: entered, voxel: -1};
  }
  return nearest < 0 ? null : {cell: Array.from(cells.subarray(4 * nearest, 4 * nearest + 3)), voxel: nearest};
}
