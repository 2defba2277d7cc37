#!/usr/bin/env bash
# Runs libFuzzer's programs of parsers, as many at a time as there are processors. Their corpora stay in
# BUILD_DIR/fuzz, so that the next run goes on; what they find is there too.
# usage: run.sh BUILD_DIR SECONDS PARSER...
# Exit: 0 if nothing was found.
set -euo pipefail
build="$(realpath "${1:?usage: run.sh BUILD_DIR SECONDS PARSER...}")"
seconds="${2:?usage: run.sh BUILD_DIR SECONDS PARSER...}"
shift 2
export ASAN_OPTIONS=detect_stack_use_after_return=1:strict_string_checks=1 UBSAN_OPTIONS=print_stacktrace=1

fuzz() { # BUILD_DIR SECONDS PARSER
  local folder="$1/fuzz/$3" result=clean
  mkdir -p "$folder/corpus" "$folder/found"
  "$1/bin/$3_fuzz" "$folder/corpus" -max_total_time="$2" -max_len=16384 -timeout=60 -rss_limit_mb=3000 \
    -artifact_prefix="$folder/found/" -print_final_stats=1 >"$folder/log" 2>&1 || result="FAILED, see $folder/log"
  local cases reached
  cases="$(sed -n 's/^stat::number_of_executed_units: *//p' "$folder/log")"
  reached="$(sed -n 's/.* cov: \([0-9]*\) .*/\1/p' "$folder/log" | tail -n 1)"
  echo "$3: ${cases:-?} cases in $2 s, ${reached:-?} edges reached, $result"
  [[ "$result" == clean ]]
}
export -f fuzz
# xargs fails if one of them does.
printf '%s\n' "$@" | xargs -P "$(nproc)" -I{} bash -c 'fuzz "$@"' fuzz "$build" "$seconds" {}
