#!/usr/bin/env bash
# The presets that CI does not build with can be configured: a sanitizer's, the shipped one, Clang's where it is there.
# usage: presets.sh SOURCE_DIR WORK_DIR
set -euo pipefail
work="$2"
cd "$1"
presets=(release cpu-only asan tsan)
command -v clang++ >/dev/null && presets+=(fuzz)
rm -rf "$work"
for preset in "${presets[@]}"; do
  mkdir -p "$work/$preset"
  cmake --preset "$preset" -B "$work/$preset" >"$work/$preset/configure.log" 2>&1 ||
    { cat "$work/$preset/configure.log"; echo "the preset $preset cannot be configured" >&2; exit 1; }
  echo "$preset: configured"
done
