#!/usr/bin/env bash
# cpu_results.sh BUILD_DIR --old NAME=PROGRAM... [more options of compare_programs.py]: makes the CPU's files of results
# that RESULTS.md begins with: BUILD_DIR's command line beside those of older commits, in turns, and whole calls from
# files' bytes. For a quiet machine. It builds what it needs in BUILD_DIR. RESULTS_DIR: where the files go, instead of
# results/ beside this script. Exit: 1 if a row failed; the others are measured all the same.
set -euo pipefail
build=$1
shift
here=$(cd "$(dirname "$0")" && pwd)
results=${RESULTS_DIR:-$here/results}
meshes=$(mktemp -d)
trap 'rm -rf "$meshes"' EXIT
about=(--machine "$(nproc) cores, $(sed -n 's/^model name.*: //p' /proc/cpuinfo | head -1)"
  --commit "$(git -C "$here" describe --always --dirty 2>/dev/null || echo unknown)")
code=0
cmake --build "$build" --target voxelpipe whole_calls write_mesh
"$build/bin/write_mesh" "$meshes/sphere1M.glb"
"$build/bin/write_mesh" "$meshes/masked.glb" --masked
"$build/bin/write_mesh" "$meshes/maze.glb" --maze
bash "$here/../support/python.sh" "$here/compare_programs.py" "$build/bin/voxelpipe" \
  --mesh sphere1M="$meshes/sphere1M.glb" --mesh masked="$meshes/masked.glb" --mesh maze="$meshes/maze.glb" \
  --out "$results" "${about[@]}" "$@" || code=$?
if ((code > 1)); then exit "$code"; fi # 1: a row failed, as those do that an older program does not have
"$build/bin/whole_calls" --threads 2 | tee "$meshes/calls.log" || code=$?
bash "$here/../support/python.sh" "$here/import_results.py" "$meshes/calls.log" --out "$results" "${about[@]}" \
  --method "\`whole_calls --threads 2\`: medians of 7 calls after one, wall time."
exit "$code"
