#!/usr/bin/env bash
# bench.sh BUILD_DIR [voxelize_bench's options]: runs the benchmarks and prints their table, with the machine and the commit.
set -euo pipefail
build=$1
shift
out=$build/bench
mkdir -p "$out"
program=$(find "$build" -name voxelize_bench -type f -perm -u+x | head -1)
"$program" --benchmark_out="$out/results.json" --benchmark_out_format=json "$@" >&2
{
  echo "Machine: $(nproc) cores, $(sed -n 's/^model name.*: //p' /proc/cpuinfo | head -1); commit $(git describe --always --dirty 2>/dev/null || echo unknown); options: ${*:-none}"
  echo
  bash "$(dirname "$0")/../support/python.sh" "$(dirname "$0")/table.py" "$out/results.json"
} | tee "$out/results.md"
