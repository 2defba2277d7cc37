#!/usr/bin/env bash
# Everything that needs a GPU, on a bare machine with a driver and the CUDA toolkit; from where make gpu-bundle put it.
#
# usage: run.sh [-o LOG_DIR] [-f FILTER] [SECTION]...      sections:
#   parity    CPU bytes = CUDA bytes over all cases and models
#   sanitize  compute-sanitizer's four tools on the quick cases
#   sanitize_large  the same, where small grids go the ways of those that are larger than the cache
#   devices   several threads on each device, and each lost and back
#   device    the arithmetic headers on both devices
#   cli       the command line's hash, cuda against cpu
#   server    voxelpiped on the GPU, its results' hash
#   service   load on voxelpiped: small jobs with and without batches, on the GPU and on the CPU
#   bench     the table, stage times, whole calls
#   calls     from a mesh file's bytes to the result, step by step; from a mesh in memory, at sizes beside limits
#   plans     what runs take of host and device against their plans
#   meshes    parity on the benchmark's meshes at 512^3 and 1024^3
#   profile   Nsight Compute on the largest rows
# Without sections: all; parity, device, cli and server side by side, the others alone.
#   -f FILTER  of cuda_parity (parity) and cuda_bench (bench, profile)
#   LIMIT=N    environment: seconds a section may take, in place of its own limit
# Logs go to LOG_DIR (default ./gpu-logs), one a section; figures of bench, calls and service to LOG_DIR/results as
# JSON. The last lines are a summary. Exit 0 if all passed.
set -uo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
logs="gpu-logs"
filter=""
while getopts "o:f:" option; do
  case "$option" in
    o) logs="$OPTARG" ;;
    f) filter="$OPTARG" ;;
    *) exit 2 ;;
  esac
done
shift $((OPTIND - 1))
mkdir -p "$logs"
find "$here/bin" "$here/lib" -name '*.gz' -exec gunzip -f {} +
bin="$here/bin"
export PATH="$PATH:/usr/local/cuda/bin"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT

# The bunny with all its triangles, where the bundle has it.
bunny="$(find "$here/models" -name 'stanford-bunny*' -print -quit)"
mesh_options=()
if [[ -n "$bunny" ]]; then mesh_options+=(--bunny "$bunny"); fi
models() { find "$here/models" -name '*.glb' -o -name '*.gltf' -o -name '*.drc' | sort; }

limit() { echo "${LIMIT:-$1}"; }

parity() {
  local files options=()
  mapfile -t files < <(models)
  if [[ -n "$filter" ]]; then options=(--filter "$filter"); fi
  # Small grids by the ways of large ones, too.
  timeout "$(limit 100)" "$bin/cuda_parity" --quick --cache 2048 "${options[@]}" || return 1
  if [[ -z "$filter" ]]; then
    local kind
    for kind in buckets f32x4; do timeout "$(limit 100)" "$bin/cuda_parity" --cache 2048 --filter "$kind" || return 1; done
  fi
  timeout "$(limit 300)" "$bin/cuda_parity" "${options[@]}" --files "${files[@]}"
}

# sanitize_with TOOL [OPTION]...: cuda_parity's, after --quick.
sanitize_with() {
  local tool="$1" options=()
  shift
  if [[ "$tool" == memcheck ]]; then options=(--track-stream-ordered-races all); fi
  # Memory goes back to a stream's pool and out again before kernels that were given to the stream have run, and from then on initcheck takes it for unset.
  if [[ "$tool" == initcheck ]]; then options=(--force-blocking-launches); fi
  timeout "$(limit 240)" compute-sanitizer --tool "$tool" "${options[@]}" --error-exitcode 9 --print-limit 12 \
    "$bin/cuda_parity" --quick "$@"
}
# sanitize_quick CHECKS [OPTION]...: each check is a tool, on all quick cases, TOOL:MESH or TOOL:batches. Options are cuda_parity's.
sanitize_quick() {
  local check code result=0 checks only log in_short=()
  read -ra checks <<<"$1"
  shift
  # One after the other: beside each other they take longer.
  for check in "${checks[@]}"; do
    case "$check" in
      *:batches) only=(--batches) ;;
      *:*) only=(--filter "${check#*:}") ;;
      *) only=() ;;
    esac
    log="$work/$check.log"
    sanitize_with "${check%%:*}" "${only[@]}" "$@" >"$log" 2>&1
    code=$?
    echo "=== $check: exit $code"
    if ((code == 0)); then tail -4 "$log"; else head -c 200000 "$log"; fi
    # 2: clean, though some case is not implemented yet.
    if ((code != 0 && code != 2)); then result=1; fi
    in_short+=("$check: exit $code $(grep -E 'SUMMARY|^cuda_parity:' "$log" | sed 's/=* *//' | tr '\n' ' ')")
  done
  echo "=== in short"
  printf '%s\n' "${in_short[@]}"
  return "$result"
}

# racecheck mesh by mesh, and on the batches: on all quick cases in one process it takes ever longer and now and then does not come to an end.
sanitize() {
  sanitize_quick "memcheck initcheck synccheck racecheck:attributed96 racecheck:point racecheck:sphere# racecheck:scattered \
    racecheck:pile_in_a_voxel racecheck:rigged_shaded racecheck:giants racecheck:batches"
}
# The same where the cache is taken for a small one: kernels for grids that are larger than it, and for larger meshes, then run in small ones.
# racecheck on the mesh that is drawn in bricks and on the one whose fragments are bundled: on all it did not come to an end there.
sanitize_large() { sanitize_quick "memcheck initcheck synccheck racecheck:sphere# racecheck:of_all_sizes" --cache 2048; }

device() {
  timeout "$(limit 60)" "$bin/device_parity"
}

devices() {
  timeout "$(limit 120)" "$bin/cuda_devices"
}

# The value of a key of one line of JSON on stdin.
json() { sed -n "s/.*\"$1\": *\"\([^\"]*\)\".*/\1/p" | head -1; }

# Arguments of `voxelpipe voxelize`, one request a line.
requests() {
  cat <<'END'
--resolution 128
--resolution 200 --coverage thin --fill parity
--resolution 100 --fill flood --result sparse
--resolution 150 --target f32x3:add --shader normal
--resolution 96 --target u8x4:max --shader base_color --result sparse
--resolution 120 --target u32:first --shader triangle_id --coverage thin --result buckets
END
}

# compare_hashes LABEL FIRST SECOND MODELS: requests with the one and the other set of options, on so many models; the
# hashes must be equal, and the first must have run on `cuda`.
compare_hashes() {
  local label="$1" first="$2" second="$3" models="$4" model arguments a b different=0 count=0
  while read -r model; do
    while read -r arguments; do
      # shellcheck disable=SC2086  # the options are words
      a="$("$bin/voxelpipe" voxelize "$model" $arguments --json $first 2>&1)"
      # shellcheck disable=SC2086
      b="$("$bin/voxelpipe" voxelize "$model" $arguments --json $second 2>&1)"
      count=$((count + 1))
      if [[ -z "$(json hash <<<"$a")" || "$(json hash <<<"$a")" != "$(json hash <<<"$b")" ||
        "$(json backend <<<"$a")" != cuda ]]; then
        different=$((different + 1))
        echo "DIFFERS $(basename "$model") $arguments"
        echo "  $first: $(tr '\n' ' ' <<<"$a" | head -c 600)"
        echo "  $second: $(tr '\n' ' ' <<<"$b" | head -c 600)"
      fi
    done < <(requests)
  done < <(models | head -"$models")
  echo "$label: $count requests, $different differ"
  ((different == 0 && count > 0))
}

cli() {
  compare_hashes cli "--backend cuda" "--backend cpu" 8
}

# start_server LOG OPTION...: sets `pid` and `address`.
start_server() {
  local log="$1"
  shift
  address=""
  # Equal requests are the load here: each is to be run.
  "$bin/voxelpiped" --listen 127.0.0.1:0 --share-equal-jobs false "$@" >"$log" 2>&1 &
  pid=$!
  for _ in $(seq 100); do
    address="$(sed -n 's/^listening on //p' "$log")"
    if [[ -n "$address" ]] || ! kill -0 "$pid" 2>/dev/null; then break; fi
    sleep 0.1
  done
  if [[ -z "$address" ]]; then
    echo "the server did not start:"
    cat "$log"
    kill "$pid" 2>/dev/null
    return 1
  fi
}

server() {
  local log="$work/voxelpiped.log" address pid result
  start_server "$log" --backend cuda || return 1
  compare_hashes server "--server $address" "--backend cpu" 6
  result=$?
  kill -TERM "$pid"
  wait "$pid" || { echo "the server left with $?"; result=1; }
  tail -5 "$log"
  return "$result"
}

# One mesh of 500 triangles at 32^3, uploaded once; every request is computed.
service() {
  local backend batches clients call address pid json result=0 rows=0 options
  echo "| backend | batches | clients | call | requests/s | p50 ms | p99 ms | jobs in a batch, mean / most |" \
    "launches a request | server CPU us a request | workers | errors | result |"
  echo "|---|---|---|---|---|---|---|---|---|---|---|---|---|"
  for backend in cuda cpu; do
    for batches in yes no; do
      options=(--backend "$backend" --log-level error --lame-duck-ms 0)
      if [[ "$batches" == no ]]; then options+=(--max-batch-jobs 1); fi
      start_server "$work/service.log" "${options[@]}" || return 1
      for clients in 16 64; do
        for call in single many; do
          options=(--resolution 32 --fit cube --backend "$backend" --concurrency "$clients" --connections 8)
          if [[ "$call" == many ]]; then options+=(--many); fi
          rows=$((rows + 1))
          json="$(timeout 30 "$bin/voxelpipe" bench "$here/models/ball.glb" --server "$address" "${options[@]}" \
            --duration "${SERVICE_SECONDS:-3}" --warmup 0.5 --server-pid "$pid" --json)" || result=1
          /usr/bin/env python3 "$here/service_row.py" "$backend" "$batches" "$clients" "$call" <<<"$json" || result=1
        done
      done
      kill -TERM "$pid"
      wait "$pid" || { echo "the server left with $?"; tail -5 "$work/service.log"; result=1; }
    done
  done
  echo "service: $rows rows"
  return "$result"
}

bench() {
  local options=("${mesh_options[@]}") seconds
  seconds="$(limit 200)"
  if [[ -n "$filter" ]]; then options+=(--filter "$filter"); fi
  timeout "$((seconds + 30))" "$bin/cuda_bench" --budget "$seconds" "${options[@]}"
}

calls() {
  local result=0
  timeout "$(limit 300)" "$bin/whole_calls" --backend cuda || result=$?
  echo # a table ends where no line follows it
  timeout "$(limit 200)" "$bin/whole_calls_bench" --repeats 20 "${mesh_options[@]}" ||
    result=$((result == 0 ? $? : result))
  return "$result"
}

# save_results SECTION: the tables of its log as JSON files in LOG_DIR/results (tests/bench/bench_file.py).
save_results() {
  python3 "$here/import_results.py" "$logs/$1.log" --out "$logs/results" --commit "$(cat "$here/COMMIT")" \
    --machine "${gpu:-no GPU}, $(nproc) cores" --method "\`gpu-bundle/run.sh $1\`."
}

plans() {
  timeout "$(limit 300)" "$bin/plan_bounds" --backend cuda --jobs "${PLAN_JOBS:-600}"
}

meshes() {
  timeout "$(limit 120)" "$bin/cuda_parity" --bench-meshes "${mesh_options[@]}"
}

profile() {
  local ncu which="${filter:-10M}"
  ncu="$(command -v ncu || find /opt/nvidia/nsight-compute -maxdepth 2 -name ncu -print -quit 2>/dev/null)"
  if [[ -z "$ncu" ]]; then
    echo "ncu is not here"
    return 1
  fi
  timeout "$(limit 150)" "$ncu" --clock-control none --section SpeedOfLight --section Occupancy \
    --section WarpStateStats --section LaunchStats --csv --page raw "$bin/cuda_bench" --only stages --filter "$which" \
    --repeats 1 --warmup 0 "${mesh_options[@]}" >"$logs/profile.csv" 2>"$work/ncu.err" || tail -5 "$work/ncu.err"
  python3 "$here/profile_table.py" "$logs/profile.csv"
}

declare -A code seconds
run_section() {
  local begin=$SECONDS
  "$1" >"$logs/$1.log" 2>&1
  code[$1]=$?
  seconds[$1]=$((SECONDS - begin))
}

sections=("$@")
if ((${#sections[@]} == 0)); then
  sections=(parity sanitize sanitize_large device cli server devices service bench calls plans meshes profile)
fi
together=()
alone=()
for section in "${sections[@]}"; do
  case "$section" in
    parity | device | cli | server) together+=("$section") ;;
    bench | calls | devices | meshes | plans | profile | sanitize | sanitize_large | service) alone+=("$section") ;;
    *) echo "run.sh: no section '$section'" >&2; exit 2 ;;
  esac
done

gpu="$(nvidia-smi --query-gpu=name,driver_version --format=csv,noheader 2>/dev/null | head -1)"
echo "VoxelPipe $(cat "$here/COMMIT"), GPU: ${gpu:-none found}, $(nproc) cores"
# Those whose times mean nothing run side by side, each writing its exit code.
for section in "${together[@]}"; do
  (
    run_section "$section"
    echo "${code[$section]} ${seconds[$section]}" >"$work/$section.code"
  ) &
done
wait
for section in "${together[@]}"; do read -r code[$section] seconds[$section] <"$work/$section.code"; done
for section in "${alone[@]}"; do run_section "$section"; done
for section in bench calls service; do
  if [[ -n "${code[$section]:-}" ]]; then save_results "$section"; fi
done

failed=0
for section in "${sections[@]}"; do
  echo
  echo "--- $section"
  case "$section" in
    bench | calls | plans | profile | service) head -c 14000 "$logs/$section.log" ;;
    parity | meshes) grep -Ev ' triangles +[0-9]+ cases' "$logs/$section.log" | head -c 9000 ;;
    sanitize) sed -n '/=== in short/,$p' "$logs/$section.log" ;;
    *) tail -12 "$logs/$section.log" ;;
  esac
done
echo
echo "--- summary"
for section in "${sections[@]}"; do
  case "${code[$section]}" in
    0) word=passed ;;
    77) word="SKIPPED: no CUDA device" ;;
    2) word="INCOMPLETE: some cases are not implemented" ;;
    124) word="TIME OUT" ;;
    *) word="FAILED (exit ${code[$section]})" ;;
  esac
  if [[ "$word" != passed ]]; then failed=1; fi
  line="$(grep -E '^(cuda_parity|cuda_bench|cuda_devices|cli|server|service|plan_bounds):' "$logs/$section.log" | tail -1)"
  printf '%-14s %4s s  %s  %s\n' "$section" "${seconds[$section]}" "$word" "$line"
done
exit "$failed"
