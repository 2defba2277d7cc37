#!/usr/bin/env bash
# Runs the wheels in a tree of files where nothing else is ours, as on another Linux: first with Python, numpy and the
# C++ library, and no package that VoxelPipe is built with; then with grpcio and protobuf too, the blocks of the guide
# and its examples.
# usage: wheels_elsewhere.sh WORK_FOLDER VOXELPIPE     after wheels.sh in the same folder
# Exit status 77 with the reason: there are no wheels, or no such tree can be made or entered.
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)"
source="$here/../.."
work="$1" voxelpipe="$2"
skip() { echo "skipped: $*"; exit 77; }
fail() { echo "wheels_elsewhere.sh: $*" >&2; exit 1; }
[[ "$(id -u)" -eq 0 ]] || skip "a tree of files takes root to enter"
command -v dpkg-query >/dev/null || skip "the files of such a tree are found by Debian's lists"
command -v openssl >/dev/null || skip "openssl makes the guide's certificate"
unshare --mount --pid --fork true 2>/dev/null || skip "this machine gives no namespaces"
compgen -G "$work/dist/voxelpipe_core-*.whl" >/dev/null || skip "no wheels: test python_wheels"

tree="$work/tree"
rm -rf --one-file-system "$tree"
# in_tree.sh mounts the devices in the tree's own namespace, and makes their files in the tree's folder before.
there() {
  setpriv --pdeathsig KILL unshare --mount --pid --mount-proc --fork --kill-child -- \
    bash "$source/tests/fresh/in_tree.sh" "$tree" /root PATH=/usr/bin:/bin HOME=/root LANG=C.UTF-8 "$@" </dev/null
}
add() { bash "$here/tests/wheels/clean_tree.sh" "$tree" "$@"; }

add python3 python3-numpy libstdc++6 bash dash coreutils
bash "$source/tests/support/python.sh" -m pip -q install --no-index --no-deps --no-warn-script-location \
  --root-user-action ignore --root "$tree" "$work"/dist/*.whl
if find "$tree" -not -path '*/voxelpipe_core/*' | grep -E '/lib(absl|draco|grpc|protobuf|tbb)'; then
  fail "the tree has libraries of VoxelPipe's"
fi
bash "$source/tests/support/python.sh" "$source/tests/support/make_ball.py" "$tree/root/bunny.glb"
"$voxelpipe" voxelize "$tree/root/bunny.glb" -o "$work/expected.raw" --resolution 48 >/dev/null
(cd / && "$work/venv/bin/python" -c '
import sys
from voxelpipe.options import make_request
sys.stdout.buffer.write(make_request(resolution=48).encoded)') >"$tree/root/request"
cat >"$tree/root/bare.py" <<'EOF'
import voxelpipe_core
with open("request", "rb") as request, open("bunny.glb", "rb") as mesh:
    _, (occupancy,), _ = voxelpipe_core.run(request.read(), mesh.read(), None, None)
occupancy.tofile("module.raw")
EOF
cat >"$tree/root/bare.sh" <<'EOF'
set -eu
python3 bare.py
/usr/local/bin/voxelpipe voxelize bunny.glb -o program.raw --resolution 48 >/dev/null
coproc server { exec /usr/local/bin/voxelpiped --listen unix:/root/socket --lame-duck-ms 0; }
pid=$server_PID
read -r -t 30 -u "${server[0]}" line
[[ "$line" == "listening on "* ]]
/usr/local/bin/voxelpipe voxelize bunny.glb -o server.raw --resolution 48 --server unix:/root/socket >/dev/null
kill "$pid"
wait "$pid"
EOF
there bash bare.sh
for way in module program server; do
  cmp "$work/expected.raw" "$tree/root/$way.raw" || fail "other voxels by the $way"
done
echo "without Debian's libraries: the module, the program and the server give the same voxels"

add python3-grpcio python3-protobuf
openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 1 -subj /CN=far \
  -addext subjectAltName=IP:127.0.0.1 -keyout "$tree/root/key.pem" -out "$tree/root/cert.pem" 2>/dev/null
cp "$here/README.md" "$here/tests/wheels/guide.py" "$tree/root/"
cp -r "$here/examples" "$tree/root/"
cat >"$tree/root/guide.sh" <<'EOF'
set -eu
python3 guide.py README.md
python3 examples/glb_to_colors.py colors bunny.glb --resolution 32
python3 examples/rotating_part.py bunny.glb --steps 2 --resolution 24
python3 examples/training_set.py . shards --resolution 16
# Libraries of the same names, of grpcio and protobuf, before and after those of the wheel.
python3 -c 'import grpc, google.protobuf.message, voxelpipe_core; voxelpipe_core.shaders()'
python3 -c 'import voxelpipe_core, grpc, google.protobuf.message; voxelpipe_core.shaders()'
EOF
there bash guide.sh
[[ "$(head -c 4 "$tree/root/bunny.png" | tail -c 3)" == PNG && -s "$tree/root/colors/bunny.npz" ]] || fail "no files"
rm -rf --one-file-system "$tree"
