#!/usr/bin/env bash
# bench.sh BUILD_DIR [voxelize_bench's options]: runs the benchmarks, leaves their results in BUILD_DIR/bench/ as JSON
# files (bench_file.py describes them) and as a page, results.md, and prints the page.
set -euo pipefail
build=$1
shift
here=$(dirname "$0")
out=$build/bench
mkdir -p "$out"
program=$(find "$build" -name voxelize_bench -type f -perm -u+x | head -1)
"$program" --benchmark_out="$out/google.json" --benchmark_out_format=json "$@" >&2
rm -f "$out"/cpu-*.json # of an earlier run with other options
bash "$here/../support/python.sh" "$here/import_results.py" "$out/google.json" --out "$out" \
  --machine "$(nproc) cores, $(sed -n 's/^model name.*: //p' /proc/cpuinfo | head -1)" \
  --commit "$(git describe --always --dirty 2>/dev/null || echo unknown)" \
  --method "\`make bench\`, options: ${*:-none}." >&2
bash "$here/../support/python.sh" "$here/make_results.py" --print "$out"/cpu-*.json | tee "$out/results.md"
