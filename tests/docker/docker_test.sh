#!/usr/bin/env bash
# Builds a target of docker/Dockerfile, runs it as an operator would (read-only, no capabilities) and calls it from
# the host. Slow (it compiles the project inside the image), so it runs only when VOXELPIPE_DOCKER_TEST=1 asks for it:
# with the engine that runs, or else with a private one (root, 6 GiB of disk). No GPU is needed: without one the image
# with device code serves on the CPU.
#
# usage: docker_test.sh VOXELPIPE      VOXELPIPE: the host's CLI
# environment:
#   VOXELPIPE_DOCKER_TARGET     cpu (the default) or cuda
#   VOXELPIPE_DOCKER_CUDA_BASE  for cuda: an image of Debian 12 with nvcc 13; else the host's toolkit, or NVIDIA's packages
#   VOXELPIPE_DOCKER_DIR        where the private engine keeps its data; kept afterwards if given
# Exit: 0 passed, 77 skipped with a printed reason, anything else failed.
set -euo pipefail
voxelpipe="$(realpath "${1:?usage: docker_test.sh VOXELPIPE}")"
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
source tests/docker/engine.sh

target="${VOXELPIPE_DOCKER_TARGET:-cpu}"
# Of this run: the engine may be one that others use, too.
image="voxelpipe-test:$target-$$"
container="voxelpipe-docker-test-$$"
keep="${VOXELPIPE_DOCKER_DIR:-}"
work="$(mktemp -d)"
dir="${keep:-$work/engine}"
DOCKER=()

cleanup() {
  if [[ ${#DOCKER[@]} -gt 0 ]]; then
    "${DOCKER[@]}" rm -f "$container" >/dev/null 2>&1 || true
    "${DOCKER[@]}" rmi --no-prune "$image" >/dev/null 2>&1 || true
  fi
  engine_stop
  rm -rf "$work"
}
trap cleanup EXIT
fail() { echo "FAILED: $*" >&2; exit 1; }
now_s() { date +%s; }

[[ "$target" == cpu || "$target" == cuda ]] || fail "VOXELPIPE_DOCKER_TARGET is $target, not cpu or cuda"
[[ -x "$voxelpipe" ]] || fail "$voxelpipe is no program; build it first"
engine_start "$dir"
engine_base_image
arguments=()
if [[ "$target" == cuda ]]; then
  engine_cuda_image
  arguments=(--build-arg "CUDA_BASE=$CUDA_BASE")
fi

start="$(now_s)"
DOCKER_BUILDKIT=1 "${DOCKER[@]}" build --network host --progress plain -f docker/Dockerfile --target "$target" \
  ${arguments[@]+"${arguments[@]}"} -t "$image" . \
  >"$work/build.log" 2>&1 || { tail -n 40 "$work/build.log"; fail "docker build"; }
echo "built in $(($(now_s) - start)) s, $(($("${DOCKER[@]}" image inspect -f '{{.Size}}' "$image") / 1048576)) MiB"

# The containers share the host's network, so the service needs a port that is free here: one that the system chooses.
port="$(bash tests/support/python.sh -c 'import socket; s = socket.create_server(("", 0)); print(s.getsockname()[1])')"
address="127.0.0.1:$port"

[[ "$("${DOCKER[@]}" image inspect -f '{{.Config.StopSignal}}' "$image")" == SIGTERM ]] || fail "STOPSIGNAL is not SIGTERM"
"${DOCKER[@]}" rm -f "$container" >/dev/null 2>&1 || true
"${DOCKER[@]}" run -d --name "$container" --network host -e "VOXELPIPE_LISTEN=0.0.0.0:$port" --read-only --cap-drop ALL \
  --security-opt no-new-privileges "$image" >/dev/null

health=
for _ in $(seq 120); do
  health="$("${DOCKER[@]}" inspect -f '{{.State.Status}} {{.State.Health.Status}}' "$container")"
  [[ "$health" == "running starting" ]] || break
  sleep 0.5
done
[[ "$health" == "running healthy" ]] || { "${DOCKER[@]}" logs "$container"; fail "the container is: $health"; }
user="$("${DOCKER[@]}" exec "$container" id -u)"
[[ "$user" != 0 ]] || fail "the service runs as root"
echo "healthy, uid $user, read-only root, no capabilities"

bash tests/support/python.sh tests/support/make_tetrahedron.py "$work/tetrahedron.glb"
options=(--resolution 64 --fill parity --json)
"$voxelpipe" server-info --server "$address" || fail "server-info"
"$voxelpipe" voxelize "$work/tetrahedron.glb" --server "$address" "${options[@]}" >"$work/served.json" || fail "voxelize over gRPC"
"$voxelpipe" voxelize "$work/tetrahedron.glb" "${options[@]}" >"$work/local.json" || fail "voxelize in-process"
bash tests/support/python.sh - "$work/served.json" "$work/local.json" <<'PYTHON' || fail "the container's answer differs from the host's"
import json, sys
served, local = (json.load(open(path)) for path in sys.argv[1:])
keys = ("triangles", "dims", "occupied", "bytes", "hash")
print("container:", {key: served[key] for key in keys})
sys.exit(any(served[key] != local[key] for key in keys) or served["occupied"] == 0)
PYTHON

"${DOCKER[@]}" stop -t 30 "$container" >/dev/null
code="$("${DOCKER[@]}" inspect -f '{{.State.ExitCode}}' "$container")"
[[ "$code" == 0 ]] || { "${DOCKER[@]}" logs "$container"; fail "the service ended with exit code $code after SIGTERM"; }
echo "stopped with exit code 0"

# What the container has of the machine is what the service takes: 1.5 CPUs are 2 threads, 512 MiB give the mesh store 28.8.
"${DOCKER[@]}" rm -f "$container" >/dev/null
"${DOCKER[@]}" run -d --name "$container" --network host -e "VOXELPIPE_LISTEN=0.0.0.0:$port" --read-only --cap-drop ALL \
  --security-opt no-new-privileges --cpus 1.5 --memory 512m "$image" >/dev/null
for _ in $(seq 120); do
  "$voxelpipe" server-info --server "$address" --json >"$work/bounded.json" 2>/dev/null && break
  sleep 0.5
done
bash tests/support/python.sh - "$work/bounded.json" <<'PYTHON' || { "${DOCKER[@]}" logs "$container"; fail "not the container's CPUs and memory"; }
import json, os, sys
info = json.load(open(sys.argv[1]))
found = {"threads": info["threads"], "max_mesh_store_bytes": info["limits"]["max_mesh_store_bytes"]}
print("bounded container:", found)
sys.exit(found != {"threads": min(2, len(os.sched_getaffinity(0))), "max_mesh_store_bytes": (512 << 20) // 10 * 9 // 16})
PYTHON
"${DOCKER[@]}" stop -t 30 "$container" >/dev/null
echo "PASSED"
