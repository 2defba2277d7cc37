#!/usr/bin/env bash
# usage: lint.sh format BUILD_DIR   format every source in place
#        lint.sh lint BUILD_DIR     check formatting, run clang-tidy and buf; exit 1 if anything was found
# TIDY_FILES="a.cpp b.cpp" narrows clang-tidy down; all .cpp files take minutes.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
mode="$1"
build_dir="${2:-build}"

# Version 14 is Debian 12's; another version formats differently.
find_tool() {
  local name
  for name in "$1-14" "$1"; do
    if command -v "$name" >/dev/null && "$name" --version | grep -q 'version 14\.'; then
      echo "$name"
      return
    fi
  done
}
need_tool() {
  local tool
  tool="$(find_tool "$1")"
  if [[ -z "$tool" ]]; then
    bash tests/support/apt_install.sh "$1-14" >&2
    tool="$(find_tool "$1")"
  fi
  [[ -n "$tool" ]] || { echo "lint: $1 14 is not installed" >&2; exit 1; }
  echo "$tool"
}

mapfile -t sources < <(git ls-files --cached --others --exclude-standard '*.h' '*.cpp' '*.cu' '*.cuh')
clang_format="$(need_tool clang-format)"
if [[ "$mode" == format ]]; then
  "$clang_format" -i "${sources[@]}"
  echo "format: ${#sources[@]} files"
  exit 0
fi

failed=0
echo "lint: clang-format on ${#sources[@]} files"
"$clang_format" --dry-run --Werror "${sources[@]}" || failed=1

clang_tidy="$(need_tool clang-tidy)"
if [[ ! -f "$build_dir/compile_commands.json" ]]; then
  echo "lint: $build_dir/compile_commands.json is missing; run make build first" >&2
  exit 1
fi
if [[ -n "${TIDY_FILES:-}" ]]; then
  read -r -a tidy_files <<<"$TIDY_FILES"
else
  mapfile -t tidy_files < <(git ls-files '*.cpp')
fi
echo "lint: clang-tidy on ${#tidy_files[@]} files"
# Clang knows neither GCC's precompiled headers nor its garbage collector.
tidy_dir="$(mktemp -d)"
trap 'rm -rf "$tidy_dir"' EXIT
sed -E 's# -include [^ ]*cmake_pch\.hxx##g; s# -Winvalid-pch| -fpch-preprocess| --param=ggc-min-heapsize=[0-9]+##g' "$build_dir/compile_commands.json" \
  >"$tidy_dir/compile_commands.json"
printf '%s\n' "${tidy_files[@]}" |
  xargs -P "$(nproc)" -n 1 "$clang_tidy" -p "$tidy_dir" --quiet --extra-arg=-Wno-unknown-warning-option --warnings-as-errors='*' 2> >(grep -v 'warnings generated' >&2) || failed=1

if command -v buf >/dev/null; then
  echo "lint: buf lint"
  (cd proto && buf lint) || failed=1
else
  echo "lint: buf is not installed; protos not linted"
fi
exit "$failed"
